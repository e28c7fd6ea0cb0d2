"""Built-in scenes, the same on every machine.

* builtin: catalogue of the built-in scenes, and scenes opened by name or path
* hard_cases: scenes on which renderers of crossed frusta fail
* objects: a car of about 42,000 triangles, and targets that reveal errors
"""
