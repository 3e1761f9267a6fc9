"""What every part may use: safe files, cancellation, the log, settings and the version."""
