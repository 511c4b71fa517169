"""Addresses of cameras as they may be shown."""

import re


def without_password(address: str) -> str:
    """The address as it may be shown and recorded: without "user:password@" before its host and
    without the value of a password, token or key in its query.
    """
    shown = re.sub(r"^(\w+://)[^/?#]*@", r"\1", address)
    return re.sub(r"(?i)([?&;]\w*(?:pass|pwd|token|secret|key|auth)\w*=)[^&;#]*", r"\1...", shown)
