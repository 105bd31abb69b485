"""Types that the compiled part takes."""

import os
from typing import Any, Optional, TypedDict, Union

import numpy as np
import numpy.typing as npt

Path = Union[str, "os.PathLike[str]"]

Values = npt.NDArray[np.float64]

Table = list[tuple[str, Optional[str], npt.NDArray[Any]]]
"""Columns: name, unit where the table says it, values (whole numbers or reals)."""


class Arrays(TypedDict):
    """A record by arrays."""

    name: str
    t: Values
    channels: list[tuple[str, Values]]


Source = Union[str, tuple[str, Table], Arrays]
"""A path, a named table, or arrays."""
