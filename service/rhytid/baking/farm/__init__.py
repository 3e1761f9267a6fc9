"""Baking on many machines: job bundles of Open Job Description, and Dask clusters."""
