"""A connection over which frames come in and tiles go out, for as long as it is open."""
