"""The commands: `NAME.py` has the command NAME, and the example that ends its help."""
