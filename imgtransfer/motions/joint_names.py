"""What is left of a joint's name without its prefix, side and spelling."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

_LEAST = 0.75  # of the joints have a prefix that is one; a side's are less than half
# Of Mixamo, SMPL, VRoid, Character Creator, Source and 3ds Max's biped, whose skeletons may have many other joints.
_KNOWN_PREFIX = re.compile(r"^(?:mixamorig\d*|[mf]_avg_|J_Bip_|CC_Base_|(?:ValveBiped\W)?Bip\d+)", re.I)
# Where a name may be cut: after signs, before a capital letter that follows a small one or a digit, between digits
# and letters.
_BOUNDARY = re.compile(r"(?<=[^a-zA-Z0-9])(?=[a-zA-Z0-9])|(?<=[a-z0-9])(?=[A-Z])|(?<=[0-9])(?=[a-z])|$")


def plain_names(names: Sequence[str]) -> list[str]:
    """Names in lower case, letters and digits only, without namespaces and what nearly all of them begin with."""
    local = [_KNOWN_PREFIX.sub("", re.split(r"[:|]", name)[-1].strip()) for name in names]
    prefix = common_prefix(local)
    return [re.sub(r"[^a-z0-9]", "", _without(name, prefix).lower()) for name in local]


def common_prefix(names: Sequence[str]) -> str:
    """The longest beginning, up to where a word ends, of at least three quarters of four or more names; or ""."""
    if len(names) < 4:
        return ""
    prefixes = Counter(
        name[: match.start()] for name in names for match in _BOUNDARY.finditer(name) if match.start() > 0
    )
    shared = [prefix for prefix, count in prefixes.items() if count >= _LEAST * len(names)]
    return max(shared, key=len, default="")


def _without(name: str, prefix: str) -> str:
    return name[len(prefix) :] if name.startswith(prefix) else name
