"""Pores: where they lie, how far apart, and what shape they have."""
