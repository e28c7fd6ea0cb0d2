"""A package, so that tests can share modules."""
