"""Typed errors: each names the value, the bound and the remedy."""

from pathlib import Path


class TorosError(Exception):
    """Base class of every error that `toros_fem` raises on purpose."""


class ParameterError(TorosError, ValueError):
    """A parameter, for files and command lines the key, is outside its admissible range."""

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
    """A sewing pattern is not a valid surface; the message names triangle, edge or panel."""


class DegenerateTriangleError(PatternError):
    """A triangle has no flat area, or uses a vertex twice."""


class OrientationError(PatternError):
    """Two neighbours, or a triangle and its panel, are oriented differently."""


class ManifoldError(PatternError):
    """An edge has more than two triangles, or a vertex more than one fan of them."""


class SeamError(PatternError):
    """Two edges sewn together have different lengths."""


class PanelError(PatternError):
    """A panel is empty, or shares a flat vertex with another panel."""


class OpenSkinError(PatternError):
    """Pressure on a skin with free edges: it encloses no volume."""


class OutlineError(TorosError, ValueError):
    """An outline is not a simple closed curve, or does not fit its radii, lines or planes."""


class TargetError(TorosError, ValueError):
    """A target shape does not fit the skin, or is not finite."""


class DensityError(TorosError, ValueError):
    """A density field has the wrong size, is not finite or leaves [0, 1]."""


class MetricError(TorosError, ValueError):
    """A metric returned no finite number."""


class OutputError(TorosError, OSError):
    """A result could not be written; the message names the place."""


class SheetError(TorosError, ValueError):
    """A panel fits on no sheet; the message names panel, sizes and remedy."""


class ManufactureFileError(TorosError, ValueError):
    """Machine files cannot be read back or written; the message names the folder and the fault."""


class MissingPackageError(TorosError, ImportError):
    """An optional package is not installed; the message names the extra that brings it."""


class CheckpointError(TorosError, ValueError):
    """A checkpoint cannot be read, or belongs to something else; the message names the file."""


class RunError(TorosError, OSError):
    """A run folder is in use, cannot be written to, or holds nothing that could go on."""


class NoRunError(RunError, OutputError):
    """There is no run in a folder, or no finished design where one is needed."""


class RunStoppedError(BaseException):
    """A run was stopped by a signal, a number, and can go on; its state is on disk.

    Like `KeyboardInterrupt` it is no `Exception`: what mends or skips errors does not swallow it.
    """

    def __init__(self, message: str, signal: int = 15) -> None:
        super().__init__(message)
        self.signal = signal


class SurfaceError(TorosError, ValueError):
    """A surface cannot be read, cut or unwrapped; the message names file, place or chart."""


class UnitError(SurfaceError):
    """A surface is so large or so small that the unit of its file must be another one."""


class PatternFileError(TorosError, ValueError):
    """A pattern file cannot be read; the message names the file and the fault."""


class TileFileError(TorosError, ValueError):
    """A printed tile cannot be read; the message names the file and the fault."""


class FileKeyError(TorosError, ValueError):
    """A file of keys and values cannot be read, or a key or value in it is wrong.

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


class SceneError(FileKeyError):
    """A scene file cannot be read, or a key or value in it is wrong."""


class LibraryError(FileKeyError):
    """A file of materials cannot be read, a value in it is wrong, or a material is not in it."""


class MeasurementError(FileKeyError):
    """Measured data cannot be read or fitted; the message names file, line and fault."""


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
    """Base class of every warning of `toros_fem`: something is legal, but odd."""


class UnitWarning(TorosWarning):
    """A skin has a size that a wrong unit would explain."""


class MaterialWarning(TorosWarning):
    """Materials are odd: the reinforcement is softer than the fabric."""


class OptionWarning(TorosWarning):
    """An option of PETSc that nothing uses."""


class ResolutionWarning(TorosWarning):
    """A length of the filter does not fit the mesh or the skin."""
