"""Identifications, the results of the fits behind a model, and provenance, the origin of its document."""

from __future__ import annotations

import datetime
import hashlib
import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import casadi as cs
import numpy as np
import scipy
from msgspec import Meta, to_builtins
from msgspec.structs import fields, force_setattr

from ancf_casadi.exceptions import InputError
from ancf_casadi.support.files import MAX_LEVELS, check, open_file, place
from ancf_casadi.support.inputs import check_instance, instances, is_sequence, shown
from ancf_casadi.support.specs import FieldError, Spec, convert
from ancf_casadi.version import __version__

MAX_RESULT_LEVELS = MAX_LEVELS - 4  # a result begins four levels deep in a document

NotEmpty = Annotated[str, Meta(min_length=1)]
Hash = Annotated[str, Meta(pattern="^[0-9a-f]{64}$", max_length=64)]  # $ also matches before a last line feed
Time = Annotated[
    str, Meta(pattern="^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}Z$", max_length=20, description="UTC")
]


class DataFile(Spec, frozen=True):
    """Name and hash of a file of measurements.

    Parameters
    ----------
    name : str
        Name of the file, without folders.
    sha256 : str
        SHA-256 of the content, 64 hexadecimal digits.

    Raises
    ------
    InputError
        If the name is empty, or the hash does not have 64 hexadecimal digits.

    Examples
    --------
    >>> from pathlib import Path
    >>> from ancf_casadi.export import DataFile
    >>> _ = Path("decay.csv").write_text("0.0,1.0")
    >>> file = DataFile.of("decay.csv")
    >>> file.name, file.sha256[:8]
    ('decay.csv', 'f6478e63')
    """

    name: NotEmpty
    sha256: Hash

    def __post_init__(self) -> None:
        """Validate."""
        _check_fields(self)

    @classmethod
    def of(cls, path: str | Path) -> DataFile:
        """Return name and hash of a file; one that cannot be read raises an ``InputError``."""
        digest = hashlib.sha256()
        with open_file(path) as file:
            while chunk := file.read(2**20):  # bytes
                digest.update(chunk)
        name = os.fsencode(Path(path).name).decode(errors="replace")
        return cls(name, digest.hexdigest())


class Identification(Spec, frozen=True):
    """The result of a fit, kept as plain data.

    Parameters
    ----------
    result : mapping
        Kind, estimates, intervals, covariance and warnings, as ``to_dict`` of the fit returns them.  They are kept as
        plain data, with None for numbers that are not finite.
    data : sequence of DataFile
        The files that the fit used.

    Raises
    ------
    InputError
        If the result does not state its kind and its estimates, or JSON cannot hold it.

    Examples
    --------
    >>> from ancf_casadi.export import Identification
    >>> from problems import fit_rayleigh
    >>> fit = fit_rayleigh([1.9, 10.6, 29.3], [0.010, 0.003, 0.003])
    >>> found = Identification(fit.to_dict())
    >>> print(found.summary())
    rayleigh (alpha 0.236167 +- 0.0085 1/s, beta 2.68898e-05 +- 3.7e-06 s)
    """

    result: dict[str, Any]
    data: tuple[DataFile, ...] = ()

    def __post_init__(self) -> None:
        """Validate, and keep plain data."""
        result: Any = self.result
        if not isinstance(result, Mapping) or not {"kind", "estimates"} <= result.keys():
            raise FieldError("is not the result of a fit: it does not state its kind and its estimates", "result")
        if not isinstance(result["kind"], str) or not result["kind"]:
            raise FieldError(f"must be a text, got {shown(result['kind'])}", "result.kind")
        force_setattr(self, "result", _plain(self.result, "result"))
        force_setattr(self, "data", instances(self.data, "data", DataFile, minimum=0))
        _check_fields(self)

    @classmethod
    def of(cls, result: Any, *, data: Sequence[str | Path] = ()) -> Identification:
        """Return the identification for a fit, or for the output of a command with ``--json``.

        Parameters
        ----------
        result : object with ``to_dict``, or mapping
            The fit.
        data : sequence of path
            The files that the fit used; their names and hashes are kept.

        Raises
        ------
        InputError
            If ``result`` is not the result of a fit, or a file cannot be read.

        Examples
        --------
        >>> import numpy as np
        >>> from ancf_casadi.export import Identification
        >>> from problems import fit_decay
        >>> time = np.linspace(0.0, 10.0, 1001)
        >>> fit = fit_decay(time, 0.02 * np.exp(-0.1 * time) * np.cos(12.0 * time))
        >>> Identification.of(fit).kind
        'decay'
        """
        if not is_sequence(data):
            raise InputError(f"must be a sequence of files, got {shown(data)}", "data")
        fit_data = result.to_dict() if hasattr(result, "to_dict") else result
        return cls(fit_data, tuple(DataFile.of(path) for path in data))

    @property
    def kind(self) -> str:
        """Kind of the fit: ``decay``, ``beam``, ``frequency matching``, or another word."""
        return str(self.result["kind"])

    def summary(self) -> str:
        """Return one line: the kind, the files with their hashes, and the values with standard errors."""
        files = [f"{file.name} SHA-256 {file.sha256}" for file in self.data]
        estimates = self.result["estimates"]
        rows = [row for row in estimates if isinstance(row, Mapping)] if isinstance(estimates, list) else []
        cells = [[row.get(key) for key in ("name", "value", "standard_error", "unit")] for row in rows]
        values = [
            f"{name} {value:.6g} +- {error:.2g} {unit}".rstrip()
            for name, value, error, unit in cells
            if isinstance(value, int | float) and isinstance(error, int | float)
        ]
        return f"{self.kind} ({', '.join([*files, *values])})" if files or values else self.kind


class Provenance(Spec, frozen=True):
    """Origin of a document.

    Parameters
    ----------
    written : str
        Time of writing, UTC, such as ``2025-01-31T12:00:00Z``.
    versions : mapping
        Versions of the programs that were used, by name.
    note : str
        Remark.

    Raises
    ------
    InputError
        If the time has another format, or a version or the note is not a text.

    Examples
    --------
    >>> from ancf_casadi.export import Provenance
    >>> origin = Provenance.of_this(note="strip 3", written="2025-01-31T12:00:00Z")
    >>> origin.written, sorted(origin.versions)
    ('2025-01-31T12:00:00Z', ['ancf-casadi', 'casadi', 'numpy', 'python', 'scipy'])
    """

    written: Time
    versions: dict[str, str]
    note: str = ""

    def __post_init__(self) -> None:
        """Validate."""
        check_instance(self.versions, "versions", Mapping)
        _check_fields(self)
        try:
            datetime.datetime.fromisoformat(self.written)
        except ValueError:
            raise FieldError("must be a time such as 2025-01-31T12:00:00Z", "written") from None

    @classmethod
    def of_this(cls, *, note: str = "", written: str | None = None) -> Provenance:
        """Return the provenance with the versions in use, and the present time unless another one is given."""
        now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        versions = {
            "ancf-casadi": __version__,
            "casadi": cs.CasadiMeta.version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        }
        return cls(now if written is None else written, versions, note)


def _check_fields(record: Spec) -> None:
    """Check that the fields have their types, and that JSON can hold them."""
    for field in fields(record):
        check(to_builtins(convert(getattr(record, field.name), field.type, field.name)), field.name)


def _plain(value: Any, where: str, level: int = 1) -> Any:
    """Return the value as plain data, with None for floats that are not finite."""
    if level > MAX_RESULT_LEVELS:
        raise InputError(f"has more than {MAX_RESULT_LEVELS} levels", where)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Mapping):
        return {key: _plain(item, place(where, key), level + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, place(where, index), level + 1) for index, item in enumerate(value)]
    raise InputError(f"must be numbers, texts, lists and objects, got a {type(value).__name__}", where)
