"""Types that the compiled part takes."""

import os
from typing import Optional, TypedDict, Union

import numpy as np
import numpy.typing as npt

Path = Union[str, "os.PathLike[str]"]

Values = npt.NDArray[np.float64]

Table = list[tuple[str, Optional[str], bytes, bool]]
"""Columns: name, unit where the table says it, numbers, whether these are whole."""


class Arrays(TypedDict):
    """A record by arrays."""

    name: str
    t: bytes
    channels: list[tuple[str, bytes]]


Source = Union[str, tuple[str, Table], Arrays]
"""A path, a named table, or arrays."""
