"""What differs from place to place: painted maps, regions, directions, folds."""
