"""From a scalar to what is seen: opacity and reflectance, baked to a table of channels."""

from volspec.transfer.model import MAX_CHANNELS, TransferFunction, TransferTable

__all__ = ["MAX_CHANNELS", "TransferFunction", "TransferTable"]
