"""Uploads to facts: what is large or compressed is decoded in a process with limits."""
