"""The one exception for input that the user can mend."""


class InputError(ValueError):
    """Input that cannot be used: says the file or argument, what was wanted, what was found, what to do.

    The command line prints the message as one line and exits with status 2; library callers may catch it.
    """
