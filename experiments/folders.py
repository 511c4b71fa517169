"""Where results go: a folder that can be written, or one clear line."""

from pathlib import Path

from experiments.run_folder import replace_json


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
    path = folder / "results.json"
    replace_json(path, results)
    return path
