"""The one exception that means "the user can fix this"."""


class InputError(Exception):
    """Bad input: one line that says what is wrong, where, and what to do. The command ends with status 2."""
