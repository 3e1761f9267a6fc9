"""Uploads to facts: what is large or hard to bound is decoded in a process with limits."""
