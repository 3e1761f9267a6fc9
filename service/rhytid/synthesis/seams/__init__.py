"""What crosses or reaches over a UV seam."""
