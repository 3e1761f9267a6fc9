"""Contact sheets: a face, its stretch and its skin side by side."""
