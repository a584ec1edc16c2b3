"""Where from the picture is seen, what is cut away, slices, and handles for all of it."""
