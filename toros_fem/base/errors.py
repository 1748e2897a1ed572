"""Typed errors: each names the value, the bound and the remedy."""

from pathlib import Path


class TorosError(Exception):
    """Base class of every error that `toros_fem` raises on purpose."""


class ParameterError(TorosError, ValueError):
    """A parameter is outside its admissible range, or a field does not fit its skin.

    Attributes:
        key: The parameter, for files and command lines; None where it is about no key.
    """

    def __init__(self, message: str, key: str | None = None) -> None:
        super().__init__(message)
        self.key = key


class MeshSizeError(ParameterError):
    """A mesh, of an area in m², would have more triangles than the limit.

    The message names an edge length.
    """

    # Between ranks an error is made from its message alone, and then gets its attributes.
    def __init__(self, message: str, area: float = 0.0, key: str | None = None) -> None:
        super().__init__(message, key)
        self.area = area


class PatternError(TorosError, ValueError):
    """A sewing pattern is not a valid surface; the message names triangle, edge or panel.

    Its triangles, seams, orientations or vertices do not fit, or it is open under pressure.
    """


class PanelError(PatternError):
    """A panel is empty or unknown, or shares a flat vertex with another panel."""


class OutlineError(TorosError, ValueError):
    """An outline is no simple closed curve, or does not fit its radii, lines, planes or sheet."""


class OutputError(TorosError, OSError):
    """A folder or file cannot be written to, or is in use; the message names the place."""


class MissingPackageError(TorosError, ImportError):
    """An optional package is not installed; the message names the extra that brings it."""


class CheckpointError(TorosError, ValueError):
    """A checkpoint cannot be read, or belongs to something else; the message names the file."""


class RunStoppedError(BaseException):
    """A run was stopped by a signal, a number, and can go on; its state is on disk.

    Like `KeyboardInterrupt` it is no `Exception`: what mends or skips errors does not swallow it.
    """

    def __init__(self, message: str, signal: int = 15) -> None:
        super().__init__(message)
        self.signal = signal


class SurfaceError(TorosError, ValueError):
    """A surface cannot be read, cut or unwrapped; the message names file, place or chart."""


class FileError(TorosError, ValueError):
    """A file or folder cannot be read, or what stands in it is wrong; the message names it.

    Attributes:
        path: The file; None for a change that the command line gives.
        line: Line in it, from 1; None where there is none.
        key: Key with its table, "design.seed" for instance; None where it is about no key.
    """

    def __init__(
        self,
        message: str,
        path: Path | None = None,
        line: int | None = None,
        key: str | None = None,
    ) -> None:
        super().__init__(message)
        self.path, self.line, self.key = path, line, key


class NoEquilibriumError(TorosError, RuntimeError):
    """No equilibrium was found."""

    @property
    def steps(self) -> int:
        """Newton steps that it took, as far as is known."""
        return 0

    @property
    def factorisations(self) -> int:
        """Factorisations that it took, as far as is known."""
        return 0


class TorosWarning(UserWarning):
    """Something is legal, but odd."""
