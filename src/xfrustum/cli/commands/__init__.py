"""The commands, in modules by their use (`app.USES`), each with the example that ends its help."""
