"""The bundled cases."""

from importlib import resources
from pathlib import Path


def bundled() -> dict[str, Path]:
    """The files of the package's bundled cases, by the cases' names."""
    folder = Path(str(resources.files(__name__)))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
