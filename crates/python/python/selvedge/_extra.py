"""Packages that not everyone needs."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports of an optional part; raises `ImportError` that names the extra of pip that is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "selvedge":
            raise
        wanted = f"pip install 'selvedge[{name}]'"
        raise ImportError(f"{name}: the package {error.name} is missing: {wanted}", name=error.name) from error
