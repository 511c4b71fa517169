"""Token files: a secret of a server in a file that only its owner can read.

`rig serve` and `rig dashboard` let in only who knows the token of such a file.
"""

import os
import secrets
import socket
import stat
import sys
from contextlib import suppress
from pathlib import Path

from rig.files import put_aside

EVERY_ADDRESS = ("0.0.0.0", "::")
SHORTEST_TOKEN = 16  # characters; chosen: 64 random bits, written as hexadecimal digits


def check_host(host: str) -> None:
    """Refuse a host to listen at that is every address of this machine without saying so.

    ValueError: it is empty, or another form of 0.0.0.0 or ::, such as 0 or 0x0; the network has to
    be asked for by one of those two.
    """
    if not host.strip():
        raise ValueError("--host is empty: name an address, such as 127.0.0.1 or 0.0.0.0 for all")
    try:
        found = {str(one[4][0]) for one in socket.getaddrinfo(host, None)}
    except (OSError, ValueError):  # no address: who listens there says so
        return
    if host not in EVERY_ADDRESS and found & set(EVERY_ADDRESS):
        raise ValueError(
            f"--host {host} is every address of this machine: write 0.0.0.0 or :: for that"
        )


def read_token(path: Path) -> bytes:
    """Return the token of a file, its first line.

    FileNotFoundError: no such file. ValueError: others than its owner can read it, or it holds
    fewer than `SHORTEST_TOKEN` characters. Both messages are one line and say what to do.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f'token file {path} not found: "rig serve" makes one; copy it from that machine'
        )
    mode = path.stat().st_mode
    if sys.platform != "win32" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError(f"token file {path} can be read by others: chmod 600 {path}")
    token = b"".join(_lines(path)[:1])
    if len(token) < SHORTEST_TOKEN:
        raise ValueError(
            f"token file {path} holds {len(token)} characters, {SHORTEST_TOKEN} are needed: "
            'remove it and let "rig serve" make one'
        )
    return token


def make_token(path: Path) -> None:
    """Write a new token (64 hexadecimal digits), and behind it where the file lies on its disk.
    FileExistsError: the file exists.
    """
    path.touch(mode=0o600, exist_ok=False)
    path.write_text(f"{secrets.token_hex(32)}\n{_place(path)}\n", encoding="ascii")


def is_from_here(path: Path) -> bool:
    """Whether a token file was made where it lies: in a folder that somebody packed and sent, or
    that was copied, it is at another place of the disk, and who sent it knows the token.
    """
    return _lines(path)[1:] == [_place(path).encode()]


def keep_token(path: Path) -> str:
    """Return the token of a file that was made here; a new one where there is none, where
    `read_token` refuses the file, and where it came from elsewhere.

    A server that is started again keeps its token, so that an open page finds it again. Delete the
    file for a new token. What is not taken may be somebody's file of that name: it is kept beside
    the new one as NAME.1, NAME.2 ... ValueError: it is a folder, a pipe or a link to nothing.
    OSError: it cannot be written.
    """
    if os.path.lexists(path):
        if not path.is_file():
            raise ValueError(f"{path} is there and is no file: remove it, or choose another folder")
        with suppress(ValueError):  # too short, read by others, no text
            token = read_token(path).decode("ascii")
            if is_from_here(path):
                return token
        put_aside(path)
    make_token(path)
    return read_token(path).decode("ascii")


def _lines(path: Path) -> list[bytes]:
    """Lines of a file, without white space at its ends and theirs."""
    return [line.strip() for line in path.read_bytes().strip().splitlines()]


def _place(path: Path) -> str:
    """Disk and number of a file, which no archive brings along."""
    known = path.stat()
    return f"{known.st_dev}-{known.st_ino}"
