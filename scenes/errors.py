"""The one exception that means "the user can fix this"."""


class InputError(Exception):
    """Bad input, in one line: the fault, the value, the remedy. Commands exit with status 2."""
