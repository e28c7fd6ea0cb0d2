"""The one exception that means "the user can fix this"."""


class InputError(Exception):
    """Bad input: one line that says what is wrong, where, and what to do.

    The command line prints the message and exits with status 2. Everything else that
    raises is a bug of ours: status 70, and its traceback in a file.
    """
