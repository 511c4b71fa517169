"""Where results go: a folder that can be written, or one clear line."""

from pathlib import Path
from typing import Any

from experiments.run_folder import plain, replace_json


def writable(folder: Path) -> Path:
    """Make `folder` and try it; PermissionError or NotADirectoryError says what to do."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.write_bytes(b"x")
        probe.unlink()
    except FileExistsError:
        raise NotADirectoryError(f"--out {folder}: is a file; name a folder") from None
    except OSError as error:
        raise PermissionError(
            f"--out {folder}: cannot be written ({error.strerror}); choose another folder"
        ) from None
    return folder


def write_results(folder: Path, results: dict) -> Path:
    """Write results.json; a number that there is not (NaN) is null."""
    path = folder / "results.json"
    write_json(path, results)
    return path


def write_json(path: Path, results: dict) -> None:
    """Write a JSON file that is whole or not there; a number that there is not is null."""
    replace_json(path, _without_nan(plain(results)))


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if value in ("nan", "inf", "-inf") else value
