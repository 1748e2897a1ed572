"""Constants from an inflated skin: shapes measured over pressure, and the simulation of that skin.

The unknowns θ are logarithms of the constants in the order of `Constant`. Gauss and Newton's method
finds the least squares. Each column of readings has a standard deviation of its own, that of its
residuals. Derivatives are those of the equilibria: K ∂q/∂θ = −∂F/∂θ with the tangent K and the
residual F, so a step costs one path and one factorisation for each pressure.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.special import stdtrit

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import FileError, NoEquilibriumError, ParameterError
from toros_fem.base.files import guarded, if_plotting, replace_file, write_json, write_table
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.scene import Scene
from toros_fem.base.toml_file import read_text
from toros_fem.base.units import DIMENSIONS, read_quantity, spelt
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes.skin import sew
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.actuators.simulate import case_to_simulate
from toros_fem.products.fitting.columns import number_of
from toros_fem.products.fitting.fit import COLOURS, FILES, Estimate, r_squared
from toros_fem.products.fitting.samples import CONFIDENCE, FEWEST, correlation
from toros_fem.products.tubes.inflate import METRICS, InflateScene
from toros_fem.products.tubes.tube import plain_tube

# Steps of Gauss and Newton's method, and halvings of a step that makes the squares larger.
MOST_STEPS, HALVINGS = 30, 6
# Largest change of an unknown by a step: no simulation starts far from what is known.
LARGEST_STEP = 0.3
# A step ends the iteration where it is this part of the standard errors; constants are held where
# it is the second part: by then it is clear which ones the readings do not tell.
ENOUGH, NEARLY = 0.01, 0.3
# Two constants that are correlated more are not told apart.
ALIKE = 0.95
# Step of an unknown for the derivative of the residual, and smallest standard deviation of readings
# over the largest of their column.
DIFFERENCE, EXACT = 1e-5, 1e-6
# Change of a constant that is held, by which others are told to change.
SHARE = 0.1
_HEADER = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]")


class Constant(NamedTuple):
    """A constant that readings may tell: what it is, its unit, and from where it is counted.

    Of a bound of eq. (1) the strain is what counts, so it is counted from 1.
    """

    title: str
    unit: str = ""
    begin: float = 0.0
    most: float = np.inf


# The constants, what is held first last.
CONSTANTS: Mapping[str, Constant] = {
    "reinforcement_young": Constant("Young's modulus of the print", "Pa"),
    "fabric_young": Constant("Young's modulus E", "Pa"),
    "along_over_around": Constant("modulus along over around"),
    "c1": Constant("bound c₁ on a stretch", begin=1.0),
    "c2": Constant("bound c₂ on their sum", begin=1.0),
    "poisson": Constant("Poisson's ratio ν", most=0.499),
}


@dataclass(frozen=True, eq=False)
class Readings:
    """What was measured of a skin over pressure.

    Attributes:
        pressures: In Pa, (n,), none below the one before.
        values: Readings by the key of their metric, (n,) each, NaN where none was taken.

    Raises:
        ParameterError: There are too few, or pressures are not positive and in order.
    """

    pressures: Floats
    values: Mapping[str, Floats]

    def __post_init__(self) -> None:
        count = len(self.pressures)
        if count < FEWEST or not self.values:
            raise ParameterError(
                f"there are readings at {count} pressures above 0; at least {FEWEST} are needed, "
                "and a column of what was measured."
            )
        if not (self.pressures[0] > 0 and (np.diff(self.pressures) >= 0).all()):
            raise ParameterError("pressures must be above 0, and none below the one before.")

    @property
    def table(self) -> Floats:
        """The readings, (k, n)."""
        return np.array([*self.values.values()])


class Inflated:
    """A skin that was inflated: a plain tube, or an actuator with its print (collective).

    Attributes:
        scene: Its sizes, its mesh, and the constants from which a fit starts.
        metrics: What may be measured of it.
        simulations: Number of paths that were simulated.
    """

    def __init__(self, comm: MPI.Comm, scene: Scene, pattern: Path | str | None = None) -> None:
        self.comm, self.scene, self.simulations = comm, scene, 0
        self._further: dict[str, Any] = {}
        if isinstance(scene, InflateScene):
            sheet, density = scene.skin, scene.material.seams
            plane, supports, density = plain_tube(comm, sheet, scene.planes, seams=density)
            self.metrics = [metric.of_whole(scene.planes) for metric in METRICS]
        elif isinstance(scene, ActuatorScene):
            case, _, density, _ = case_to_simulate(comm, scene, pattern)
            plane, supports, self.metrics = case.pattern, case.supports, list(case.judged)
            self._further = {
                name: getattr(case, name) for name in ("chambers", "contact", "quadratic")
            }
        else:
            raise ParameterError(
                f"a scene of the kind {scene.KIND!r} is no skin that is inflated; take one of a "
                "tube or another actuator."
            )
        self._skin, self._supports = sew(comm, plane), supports
        self._density = density[self._skin.owned_cells]

    def constants(self, readings: Readings, *, printed: bool) -> list[str]:
        """Return the constants that readings may tell."""
        if printed:
            return ["reinforcement_young", "fabric_young"]
        both = {"radius_percent", "length_percent"} <= readings.values.keys()
        names = ["fabric_young", "c1", "c2", "poisson"]
        if both and self.scene.value("grain_angle") == 0 and self.scene.material.knit is None:
            names.insert(1, "along_over_around")
        return names

    def keys(self, constants: Mapping[str, float]) -> dict[str, float]:
        """Return the constants as keys of the scene; a modulus of its own along a tube is a knit.

        The modulus of the fabric is that around the tube. In the scene it is that along the wales,
        the softer direction.
        """
        values = dict(constants)
        ratio = values.pop("along_over_around", 1.0)
        if ratio != 1:
            values["knit_ratio"] = max(ratio, 1 / ratio)
            values["grain_angle"] = 90.0 if ratio > 1 else 0.0
            values["fabric_young"] *= min(ratio, 1.0)
        return values

    def start(self, names: Sequence[str]) -> dict[str, float]:
        """Return the constants of the scene."""
        scene = self.scene
        return {n: 1.0 if n == "along_over_around" else float(scene.value(n)) for n in names}

    def _parts(self, constants: Mapping[str, float]) -> tuple[Any, ...]:
        scene: Any = self.scene.updated(**self.keys(constants))
        return self._skin, scene.material.composite, self._supports

    def path(self, pressures: Floats, constants: Mapping[str, float]) -> _Path:
        """Return the equilibria at pressures (collective).

        Raises:
            EquilibriumError: The path cannot be followed to its end.
        """
        self.simulations += 1
        solver = EquilibriumSolver(*self._parts(constants), **self._further)
        levels = [*map(float, np.unique(pressures))]
        points = list(trace(solver, self._density, levels, self.metrics))
        return _Path(solver, [p.result for p in points], [p.metrics for p in points])

    def measured(self, pressures: Floats, constants: Mapping[str, float]) -> dict[str, Floats]:
        """Return the simulated readings by the key of their metric, (n,) each (collective)."""
        path = self.path(pressures, constants)
        where = np.unique(pressures, return_inverse=True)[1]
        return {m.key: np.array([v[m.key] for v in path.values])[where] for m in self.metrics}

    def slopes(self, path: _Path, changed: Sequence[Mapping[str, float]], keys: Sequence[str]) -> Floats:
        """Return by how much readings change with the constants, (p, k, n) (collective).

        Args:
            changed: Constants of which one differs by `DIFFERENCE` in its logarithm.
        """
        models = [make_model(*self._parts(values), **self._further) for values in changed]
        metrics = [metric for metric in self.metrics if metric.key in keys]
        order = [[m.key for m in metrics].index(key) for key in keys]
        rows = []
        for point, values in zip(path.results, path.values, strict=True):
            at_rest = np.array([values[metric.key] for metric in metrics])
            for model in models:
                model.set_density(point.density)
                model.set_load(point.load)
                way = path.solver.solve_tangent(-model.residual(point.state), point)
                moved = self._skin.gather_vertices(model.positions(point.state + way))
                seen = [m.value(self._skin.pattern, moved) for m in metrics]
                rows.append((np.array(seen) - at_rest)[order] / DIFFERENCE)
        return np.moveaxis(np.array(rows).reshape(len(path.results), len(models), -1), 0, 2)


class _Path(NamedTuple):
    """Equilibria of one set of constants, and their metrics by key."""

    solver: EquilibriumSolver
    results: list[Equilibrium]
    values: list[dict[str, float]]


@dataclass(frozen=True, eq=False, kw_only=True)
class InflationFit:
    """Constants of an inflated skin, beside its readings.

    Attributes:
        estimates: Constants that the readings tell, by name.
        keys: The same as keys of a scene.
        held: Why constants are held at the value of the scene, as sentences by name.
        values: Those values.
        correlations: Of the constants that are told, (p, p).
        fitted: Simulated readings, by the key of their metric.
        simulations: Number of paths that were simulated.
    """

    estimates: Mapping[str, Estimate]
    keys: Mapping[str, float]
    held: Mapping[str, str]
    values: Mapping[str, float]
    correlations: Floats
    readings: Readings
    fitted: Mapping[str, Floats]
    simulations: int
    remarks: Sequence[str] = field(default_factory=tuple)

    def quality(self) -> dict[str, float]:
        """Return R² of each column."""
        return {
            key: r_squared(values[seen], self.fitted[key][seen])
            for key, values in self.readings.values.items()
            if (seen := np.isfinite(values)).any()
        }

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        return {
            "estimates": {name: asdict(one) for name, one in self.estimates.items()},
            "keys": dict(self.keys),
            "held": {n: {"value": self.values[n], "reason": self.held[n]} for n in self.held},
            "correlations": self.correlations.tolist(),
            **{f"r2_{key}": value for key, value in self.quality().items()},
            "points": len(self.readings.pressures),
            "simulations": self.simulations,
            "remarks": [*self.remarks],
        }

    def table(self) -> str:
        """Return the result as lines of text."""
        lines = [f"{'':30}{'value':>12}   {'95 % interval':<24}"]
        for name, one in self.estimates.items():
            factor, unit = 1.0, one.unit
            if unit == "Pa":
                factor, unit = (1e-6, "MPa") if one.value >= 1e6 else (1e-3, "kPa")
            interval = f"{factor * one.low:.4g} … {factor * one.high:.4g} {unit}"
            lines.append(f"{CONSTANTS[name].title:30}{factor * one.value:12.4g}   {interval}".rstrip())
        lines += [
            "R²: " + ", ".join(f"{key} {value:.4f}" for key, value in self.quality().items()),
            f"{len(self.readings.pressures)} pressures, {self.simulations} simulations",
            "in scenes: " + ", ".join(f"{key} = {value:.5g}" for key, value in self.keys.items()),
            *self.remarks,
        ]
        return "\n".join(lines)


def fit_inflation(
    comm: MPI.Comm, scene: Scene, readings: Readings, pattern: Path | str | None = None
) -> InflationFit:
    """Fit the constants of an inflated skin to what was measured of it (collective).

    Of a plain tube these are Young's modulus, its ratio along over around where diameter and length
    were measured, c₁, c₂ and Poisson's ratio; of a print its modulus and that of the fabric. A
    constant whose interval is wider than its value is held at that of the scene, and so is the
    latter of two that are correlated by more than 0.95.

    Args:
        scene: Sizes, mesh, and the constants to start from.
        pattern: Print of an actuator: folder of a design, its pattern, or a drawing.

    Raises:
        ParameterError: The scene has no such metric, or is of no skin that is inflated.
        NoEquilibriumError: The skin cannot be simulated up to the last pressure.
        FileError: The readings tell no constant.
    """
    return fitted(Inflated(comm, scene, pattern), readings, printed=pattern is not None)


def fitted(skin: Inflated, readings: Readings, *, printed: bool = False) -> InflationFit:
    """Fit constants as `fit_inflation`, of a skin that may be fitted several times (collective)."""
    for key in readings.values:
        if key not in (keys := [metric.key for metric in skin.metrics]):
            raise ParameterError(f"{key!r} is no metric of this skin; it has {', '.join(keys)}.")
    search = _Search(skin, readings, skin.constants(readings, printed=printed))
    search.run()
    return search.result()


class _Search:
    """Least squares over the constants, of which some are held."""

    def __init__(self, skin: Inflated, readings: Readings, names: list[str]) -> None:
        self.skin, self.readings, self.names = skin, readings, names
        self.before = skin.simulations
        begins = [CONSTANTS[name].begin for name in names]
        self.first = np.log([v - b for v, b in zip(skin.start(names).values(), begins, strict=True)])
        self.theta, self.free = self.first.copy(), np.ones(len(names), dtype=bool)
        self.held: dict[str, str] = {}
        self.where = np.unique(readings.pressures, return_inverse=True)[1]
        self.seen = np.isfinite(readings.table)

    def constants(self, theta: Floats) -> dict[str, float]:
        """Return the constants of unknowns by name."""
        return {
            name: float(CONSTANTS[name].begin + np.exp(at))
            for name, at in zip(self.names, theta, strict=True)
        }

    def simulated(self, theta: Floats) -> tuple[_Path, Floats]:
        """Return the path of unknowns, and its readings, (k, n)."""
        path = self.skin.path(self.readings.pressures, self.constants(theta))
        values = [[point[key] for point in path.values] for key in self.readings.values]
        return path, np.array(values)[:, self.where]

    def deviations(self, residuals: Floats) -> Floats:
        """Return the standard deviation of the readings of each column, (k, 1)."""
        left = 1 - self.free.sum() / self.seen.sum()
        squares = np.where(self.seen, residuals**2, 0.0).sum(axis=1) / self.seen.sum(axis=1)
        largest = np.nanmax(np.abs(self.readings.table), axis=1)
        return np.maximum(np.sqrt(squares / max(left, 0.1)), EXACT * largest)[:, None]

    def squares(self, values: Floats, sigma: Floats) -> float:
        """Return half the sum of squares of residuals over their deviations."""
        residuals = (self.readings.table - values) / sigma
        return float(np.sum(residuals[self.seen] ** 2) / 2)

    def run(self) -> None:
        """Find the constants, and hold those that the readings do not tell."""
        try:
            path, values = self.simulated(self.theta)
        except EquilibriumError as caught:
            raise NoEquilibriumError(
                f"with the constants of the scene the skin has no equilibrium at each pressure: "
                f"{caught} Begin with others, a stiffer fabric for instance."
            ) from None
        for _ in range(MOST_STEPS):
            self.linearise(path, values)
            step = np.zeros(len(self.theta))
            step[self.free] = self.covariance @ (self.jacobian.T @ self.residuals)[self.free]
            size = np.abs(step[self.free]) / np.sqrt(np.diag(self.covariance))
            if size.max() < NEARLY and (place := self.untold()) is not None:
                path, values = self.hold(place)
                continue
            if size.max() < ENOUGH:
                break
            further = self.moved(step * min(1.0, LARGEST_STEP / np.abs(step).max()), values)
            if further is None:
                break
            path, values = further

    def linearise(self, path: _Path, values: Floats) -> None:
        """Find the derivatives of the readings at the unknowns, over their deviations."""
        changed = []
        for k in range(len(self.theta)):
            further = self.theta.copy()
            further[k] += DIFFERENCE
            changed.append(self.constants(further))
        slopes = self.skin.slopes(path, changed, [*self.readings.values])[:, :, self.where]
        residuals = self.readings.table - values
        self.values, self.sigma = values, self.deviations(residuals)
        self.jacobian = np.array([(slope / self.sigma)[self.seen] for slope in slopes]).T
        self.residuals = (residuals / self.sigma)[self.seen]

    @property
    def covariance(self) -> Floats:
        """Covariance of the unknowns that are free, (p, p), of independent readings."""
        of_free = self.jacobian[:, self.free]
        return np.asarray(np.linalg.pinv(of_free.T @ of_free, hermitian=True))

    def moved(self, step: Floats, values: Floats) -> tuple[_Path, Floats] | None:
        """Take as much of a step as makes the squares smaller; None where none does."""
        before = self.squares(values, self.sigma)
        most = np.log([CONSTANTS[name].most for name in self.names])
        for part in 0.5 ** np.arange(HALVINGS):
            theta = np.minimum(self.theta + part * step, most)
            with suppress(EquilibriumError):  # raised by all ranks or by none
                further = self.simulated(theta)
                if self.squares(further[1], self.sigma) < before:
                    self.theta = theta
                    return further
        return None

    def hold(self, place: int) -> tuple[_Path, Floats]:
        """Hold a constant at its first value, and let the others follow as they tell."""
        self.free[place] = False
        step = np.zeros(len(self.theta))
        step[place] = self.first[place] - self.theta[place]
        left = self.residuals - self.jacobian @ step
        step[self.free] = self.covariance @ (self.jacobian.T @ left)[self.free]
        self.theta = self.theta + step
        try:
            return self.simulated(self.theta)
        except EquilibriumError:
            self.theta = self.first.copy()
            return self.simulated(self.theta)

    def untold(self) -> int | None:
        """Return the last constant that the readings do not tell, and note why; None without."""
        covariance = self.covariance
        error = np.sqrt(np.diag(covariance))
        alike = np.abs(covariance / np.outer(error, error))
        names = [name for name, free in zip(self.names, self.free, strict=True) if free]
        for k in reversed(range(len(names))):
            half, why = min(self.student * error[k], 50.0), ""
            if 2 * np.sinh(half) > 1:
                why = f"its interval would reach from 1/{np.exp(half):.2g} to {np.exp(half):.2g} times it"
            elif k and alike[k, :k].max() > ALIKE:
                other = names[int(alike[k, :k].argmax())]
                why = f"it is correlated with {other} by {alike[k, :k].max():.3f}"
            if why and len(names) == 1:
                raise FileError(
                    f"the readings tell no constant: of {names[0]}, {why}. Measure up to a "
                    "larger pressure, or more precisely."
                )
            if why:
                self.held[names[k]] = why
                return self.names.index(names[k])
        return None

    @property
    def student(self) -> float:
        """Half of a 95 % interval over the standard error; neighbours may err alike."""
        rows = np.cumsum(self.seen.sum(axis=1))[:-1]
        rho = correlation([part for part in np.split(self.residuals, rows) if len(part)])
        left = max(self.seen.sum() - self.free.sum(), 2)
        return float(stdtrit(left, 0.5 + CONFIDENCE / 2) * np.sqrt((1 + rho) / (1 - rho)))

    def result(self) -> InflationFit:
        """Return the constants with their intervals."""
        covariance, free = self.covariance, self.free
        error = np.sqrt(np.diag(covariance))
        half = np.zeros(len(free))
        half[free] = self.student * error
        values, ends = self.constants(self.theta), (self.theta - half, self.theta + half)
        low, high = (self.constants(end) for end in ends)
        names = [name for name in self.names if name not in self.held]
        columns = [*self.readings.values]
        return InflationFit(
            estimates={
                n: Estimate(values[n], low[n], high[n], True, CONSTANTS[n].unit) for n in names
            },
            keys=self.skin.keys(values),
            held=self.held,
            values=values,
            correlations=covariance / np.outer(error, error),
            readings=self.readings,
            fitted=dict(zip(columns, self.values, strict=True)),
            simulations=self.skin.simulations - self.before,
            remarks=[*self._remarks(values, names)],
        )

    def _remarks(self, values: Mapping[str, float], names: Sequence[str]) -> Iterator[str]:
        """Yield what the readings cannot tell, as sentences."""
        jacobian = self.jacobian
        for name, why in self.held.items():
            moved = -self.covariance @ (jacobian[:, self.free].T @ jacobian[:, self.names.index(name)])
            part = SHARE * (values[name] - CONSTANTS[name].begin)
            changes = ", ".join(
                f"{other} by {100 * change * SHARE * (1 - CONSTANTS[other].begin / values[other]):+.2g} %"
                for other, change in zip(names, moved, strict=True)
            )
            yield (
                f"{name} is not told, and held at {values[name]:.4g}: {why}. If it is "
                f"{values[name] + part:.4g}, this changes {changes}."
            )
        yield (
            "Thicknesses are those of the scene: an inflated skin tells E h. Intervals are of the "
            "readings' scatter, not of sizes, pressure gauge or mesh."
        )


def read_inflation(path: Path | str, scene: Scene, metrics: Sequence[Metric]) -> Readings:
    """Return the readings of a table (one rank).

    The header names a pressure, and what was measured: of a tube `diameter [mm]` and `length [mm]`,
    of any skin its metrics by name and unit, `angle [deg]` or `angle_deg`. So curve.csv of a run is
    read as it is. Rows of pressure 0 are left out, and so are other columns.

    Raises:
        FileError: A line is wrong, or something is missing.
    """
    path = Path(path)
    text = read_text(path, "a table of readings", "table")
    lines = {k: line for k, line in enumerate(text.split("\n"), start=1) if line.strip()}
    lines = {k: line for k, line in lines.items() if not line.lstrip().startswith("#")}
    if len(lines) < 2:
        raise FileError(f"{path}: there is no table: a header and rows of numbers.", path)
    begin = min(lines)
    mark = next((one for one in ";\t," if one in lines[begin]), ",")
    rows = {k: next(csv.reader([line], delimiter=mark)) for k, line in lines.items()}
    columns = dict(_columns(rows.pop(begin), scene, metrics))
    if "pressure" not in [key for key, _ in columns.values()] or len(columns) < 2:
        known = ", ".join([*(["diameter [mm]"] if _sizes(scene) else []), *(m.key for m in metrics)])
        raise FileError(
            f"{path}, line {begin}: a column 'pressure [kPa]' is needed, and one of {known}; the "
            f"header has {lines[begin].strip()}.", path, begin,
        )  # fmt: skip
    table = []
    for line, cells in rows.items():
        row = dict.fromkeys([key for key, _ in columns.values()], np.nan)
        for place, (key, read) in columns.items():
            cell = cells[place].strip() if place < len(cells) else ""
            number = number_of(cell, comma=mark != ",")
            if cell or key == "pressure":
                if not np.isfinite(number):
                    raise FileError(
                        f"{path}, line {line}: {key} = {cell!r} is no finite number.", path, line
                    )
                row[key] = read(number)
        table.append(row)
    table = sorted((row for row in table if row["pressure"] > 0), key=lambda row: row["pressure"])
    values = {key: np.array([row[key] for row in table]) for key, _ in columns.values()}
    try:
        return Readings(values.pop("pressure"), values)
    except ParameterError as caught:
        raise FileError(f"{path}: {caught}", path) from None


def _sizes(scene: Scene) -> dict[str, float]:
    """Return the lengths of a plain tube that readings in mm refer to."""
    skin = getattr(scene, "skin", None)
    return {n: getattr(skin, n) for n in ("diameter", "length") if hasattr(skin, n)}


def _columns(header: Sequence[str], scene: Scene, metrics: Sequence[Metric]) -> Iterator[Any]:
    """Yield place, key and conversion of each column that is read."""
    for place, cell in enumerate(header):
        match = _HEADER.fullmatch(cell.strip())
        name, unit = match.groups() if match else (cell.strip(), "")
        name, unit = name.strip().lower(), spelt(unit)
        if name in ("pressure_pa", "pressure"):
            yield place, ("pressure", partial(_quantity, unit=unit or "Pa", of="Pa"))
            continue
        size = _sizes(scene).get(name)
        for metric in metrics:
            of_size = "radius" if name == "diameter" else name
            if size and unit in DIMENSIONS["m"][1] and metric.name == of_size:
                whole = size / (100.0 if metric.unit == "percent" else 1.0)
                yield place, (metric.key, lambda v, u=unit, s=whole: _quantity(v, u, "m") / s)
            elif name == metric.key or (name == metric.name and unit in _units(metric)):
                factor = 100.0 if (unit, metric.unit) == ("1", "percent") else 1.0
                factor = 0.01 if (unit, metric.unit) == ("%", "ratio") else factor
                if unit in DIMENSIONS["deg"][1]:
                    factor = _quantity(1.0, unit, "deg")
                yield place, (metric.key, lambda v, f=factor: f * v)


def _units(metric: Metric) -> Sequence[str]:
    """Return the units that a reading of a metric may have."""
    return tuple(DIMENSIONS["deg"][1]) if metric.unit == "deg" else ("%", "1", metric.unit)


def _quantity(value: float, unit: str, of: str) -> float:
    return read_quantity(f"{value!r} {unit}", of)


def write_inflation(comm: MPI.Comm, folder: Path | str, result: InflationFit) -> None:
    """Write fit.json, fit.txt, fit.csv and fit.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder, readings = Path(folder), result.readings
    columns = {"pressure_pa": readings.pressures}
    for key, values in readings.values.items():
        columns |= {key: values, f"{key}_fitted": result.fitted[key]}
    rows = [dict(zip(columns, row, strict=True)) for row in np.array([*columns.values()]).T.tolist()]

    def write() -> None:
        write_json(folder / FILES[0], result.summary())
        replace_file(folder / FILES[1], f"{result.table()}\n".encode())
        write_table(folder / FILES[2], rows)
        if_plotting(lambda: plot_inflation(folder / FILES[3], result))

    guarded(comm, folder, write)


def plot_inflation(path: Path, result: InflationFit) -> None:
    """Draw readings and simulation over pressure (one rank)."""
    from toros_fem.results.pictures.style import page

    readings = result.readings
    quality = ", ".join(f"{key} {value:.4f}" for key, value in result.quality().items())
    where = {"left": 0.11, "right": 0.96, "bottom": 0.13, "top": 0.86, "wspace": 0.3}
    with page(path, f"R²: {quality}", (8.0, 4.0)) as figure:
        grid = figure.subplots(1, len(readings.values), squeeze=False, gridspec_kw=where)
        for axes, (key, values), colour in zip(grid[0], readings.values.items(), COLOURS, strict=False):
            axes.plot(readings.pressures / 1e3, values, ls="", marker=".", color=colour, alpha=0.6)
            axes.plot(readings.pressures / 1e3, result.fitted[key], color=colour, lw=1.8)
            axes.set(xlabel="pressure in kPa", ylabel=key.replace("_", " "))
            axes.grid(axis="y")
