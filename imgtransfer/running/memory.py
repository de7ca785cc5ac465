"""Memory that ran out, told from other errors."""

from __future__ import annotations

_WORDS = ("not enough memory", "out of memory", "can't allocate memory")  # torch raises a RuntimeError


def shortage(error: BaseException) -> str | None:
    """One line about an error that says that memory ran out; None for any other error."""
    text = " ".join(str(error).split())
    of_torch = isinstance(error, RuntimeError) and any(word in text for word in _WORDS)
    if not isinstance(error, MemoryError) and not of_torch:
        return None
    return f"not enough memory ({text[:200]})" if text else "not enough memory"
