"""The one exception that means "the user can fix this"."""


class InputError(Exception):
    """Bad input, in one line: the error, the value, the advice. Commands exit with status 2."""
