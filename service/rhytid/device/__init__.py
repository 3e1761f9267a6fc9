"""The OpenCL runtime: choosing a device, programs, buffers, the memory budget."""
