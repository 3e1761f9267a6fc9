"""A store that several machines share: immutable objects, and a manifest per asset."""
