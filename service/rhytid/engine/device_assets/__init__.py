"""What one asset has on the device, part by part."""
