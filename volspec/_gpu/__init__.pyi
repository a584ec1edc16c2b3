# What other packages use of this one; lazy_loader and type checkers read it.
from . import device_list as device_list
from .device_list import (
    DeviceInfo as DeviceInfo,
    device_key as device_key,
    devices as devices,
    try_all as try_all,
)
from .memory import host_free_bytes as host_free_bytes
from .opencl import Compute as Compute
from .opengl import (
    Allocation as Allocation,
    ContextLost as ContextLost,
    abandoned_queue as abandoned_queue,
    compile_program as compile_program,
    describe as describe,
    egl_handle as egl_handle,
    headless_context as headless_context,
    lend_context as lend_context,
    made_current as made_current,
    release_abandoned as release_abandoned,
    window_context as window_context,
)
from .prelude import C_TYPES as C_TYPES, Struct as Struct, prelude as prelude
from .sharing import (
    Sharing as Sharing,
    context_name as context_name,
    current as current,
    sharing_fault as sharing_fault,
)
from .sources import assemble as assemble, asset as asset
