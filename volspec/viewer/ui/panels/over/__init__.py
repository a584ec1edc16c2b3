"""What is drawn over the picture: handles, slices, the divide, the error map, the probe."""
