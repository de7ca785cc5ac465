"""The one exception for input that the user can mend."""


class InputError(ValueError):
    """Input that cannot be used: says the file or argument, what was wanted, what was found, what to do.

    The command line prints the message as one line and exits with status 2; library callers may catch it.
    """


def one_line(error: BaseException, longest: int = 200) -> str:
    """What an error of another package says, on one line, cut where it would run on; its kind where it says nothing."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= longest else text[:longest] + " ..."
