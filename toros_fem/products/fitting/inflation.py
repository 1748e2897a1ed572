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

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import FileError, NoEquilibriumError, ParameterError
from toros_fem.base.files import guarded, if_plotting, replace_file, write_json, write_table
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
ENOUGH, NEARLY = 0.03, 0.3
# Two constants that are correlated more are not told apart.
ALIKE = 0.95
# Step of an unknown for the derivative of the residual, and the smallest standard deviation of
# readings over the largest of their column.
DIFFERENCE, EXACT = 1e-5, 1e-6
# Factor by which a constant that is held may be off; of a bound its strain.
HELD = 1.2
LIMITS = (
    "Thicknesses are those of the scene: an inflated skin tells E h. Intervals are of the scatter "
    "of the readings, not of sizes, pressure gauge or mesh."
)
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

    Args:
        scene: Sizes, mesh, and the constants to start from.
        pattern: Print of an actuator: folder of a design, its pattern, or a drawing.

    Raises:
        ParameterError: The scene is of no skin that is inflated.
        TorosError: The print cannot be read, or does not fit.

    Attributes:
        scene: Its sizes, its mesh, and the constants from which a fit starts.
        metrics: What may be measured of it.
        printed: Whether it has a print.
        simulations: Number of paths that were simulated.
    """

    def __init__(self, comm: MPI.Comm, scene: Scene, pattern: Path | str | None = None) -> None:
        self.scene, self.printed, self.simulations = scene, pattern is not None, 0
        self._further: dict[str, Any] = {}
        self._first: tuple[Any, _Path] | None = None
        if isinstance(scene, InflateScene):
            plane, supports, density = plain_tube(
                comm, scene.skin, scene.planes, seams=scene.material.seams
            )
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

    def constants(self, readings: Readings) -> list[str]:
        """Return the constants that readings may tell."""
        if self.printed:
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

    def path(
        self, pressures: Floats, constants: Mapping[str, float], starts: Sequence[Floats] = ()
    ) -> _Path:
        """Return the equilibria at pressures, from states near to them if there are (collective).

        Raises:
            EquilibriumError: The path cannot be followed to its end.
        """
        self.simulations += 1
        solver = EquilibriumSolver(*self._parts(constants), **self._further)
        levels, results = [*map(float, np.unique(pressures))], list[Equilibrium]()
        with suppress(EquilibriumError, ParameterError):  # raised by all ranks or by none
            for level, start in zip(levels, starts, strict=False):
                results.append(solver.solve(self._density, level, start))
        if len(results) < len(levels):
            results = [point.result for point in trace(solver, self._density, levels)]
        pattern, values = self._skin.pattern, list[dict[str, float]]()
        for result in results:
            at = solver.positions(result)
            values.append({metric.key: metric.value(pattern, at) for metric in self.metrics})
        return _Path(solver, results, values)

    def first(self, pressures: Floats, constants: Mapping[str, float]) -> _Path:
        """Return the path that a fit starts from; several fits share it (collective)."""
        asked = pressures.tobytes(), constants
        if self._first is None or self._first[0] != asked:
            self._first = asked, self.path(pressures, constants)
        return self._first[1]

    def measured(self, pressures: Floats, constants: Mapping[str, float]) -> dict[str, Floats]:
        """Return the simulated readings by the key of their metric, (n,) each (collective)."""
        path = self.path(pressures, constants)
        where = np.unique(pressures, return_inverse=True)[1]
        return {m.key: np.array([v[m.key] for v in path.values])[where] for m in self.metrics}

    def slopes(
        self, path: _Path, changed: Sequence[Mapping[str, float]], keys: Sequence[str]
    ) -> tuple[Floats, list[Floats]]:
        """Return by how much readings change with the constants, (p, k, n) (collective).

        The second are the changes of the states, (p, unknowns) at each pressure.

        Args:
            changed: Constants of which one differs by `DIFFERENCE` in its logarithm.
        """
        models = [make_model(*self._parts(values), **self._further) for values in changed]
        metrics = {metric.key: metric for metric in self.metrics}
        rows, ways = [], []
        for point, values in zip(path.results, path.values, strict=True):
            way = np.empty((len(models), len(point.state)))
            for k, model in enumerate(models):
                model.set_density(point.density)
                model.set_load(point.load)
                way[k] = path.solver.solve_tangent(-model.residual(point.state), point)
                moved = self._skin.gather_vertices(model.positions(point.state + way[k]))
                seen = [metrics[key].value(self._skin.pattern, moved) - values[key] for key in keys]
                rows.append(np.array(seen) / DIFFERENCE)
            ways.append(way / DIFFERENCE)
        return np.moveaxis(np.array(rows).reshape(len(ways), len(models), -1), 0, 2), ways


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
        held: Constants that are held at the value of the scene: this, and why.
        correlations: Of the constants that are told, (p, p).
        fitted: Simulated readings, by the key of their metric.
        simulations: Number of paths that were simulated.
    """

    estimates: Mapping[str, Estimate]
    keys: Mapping[str, float]
    held: Mapping[str, tuple[float, str]]
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
            "held": {n: {"value": value, "reason": why} for n, (value, why) in self.held.items()},
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
            value = f"{CONSTANTS[name].title:30}{factor * one.value:12.4g}"
            lines.append(f"{value}   {interval}".rstrip())
        lines += [
            "R²: " + ", ".join(f"{key} {value:.4f}" for key, value in self.quality().items()),
            f"{len(self.readings.pressures)} pressures, {self.simulations} simulations",
            "in scenes: " + ", ".join(f"{key} = {value:.5g}" for key, value in self.keys.items()),
            *self.remarks,
        ]
        return "\n".join(lines)


def fit_inflation(skin: Inflated, readings: Readings) -> InflationFit:
    """Fit the constants of an inflated skin to what was measured of it (collective).

    Of a plain tube these are Young's modulus, its ratio along over around where diameter and length
    were measured, c₁, c₂ and Poisson's ratio; of a print its modulus and that of the fabric. A
    constant whose interval is wider than its value is held at that of the scene, and so is the
    latter of two that are correlated by more than 0.95.

    Raises:
        ParameterError: The skin has no such metric.
        NoEquilibriumError: It cannot be simulated up to the last pressure.
        FileError: The readings tell no constant.
    """
    keys = [metric.key for metric in skin.metrics]
    for key in readings.values:
        if key not in keys:
            raise ParameterError(f"{key!r} is no metric of this skin; it has {', '.join(keys)}.")
    search = _Search(skin, readings)
    search.run()
    return search.result()


class _Search:
    """Least squares over the constants, of which some are held."""

    def __init__(self, skin: Inflated, readings: Readings) -> None:
        self.skin, self.readings, self.before = skin, readings, skin.simulations
        self.names = names = skin.constants(readings)
        self.first = np.log([v - CONSTANTS[name].begin for name, v in skin.start(names).items()])
        self.most = np.log([CONSTANTS[name].most for name in names])
        self.theta, self.free = self.first.copy(), np.ones(len(names), dtype=bool)
        self.held: dict[str, str] = {}
        self.path: _Path
        self.where = np.unique(readings.pressures, return_inverse=True)[1]
        self.seen = np.isfinite(readings.table)

    def constants(self, theta: Floats) -> dict[str, float]:
        """Return the constants of unknowns by name."""
        return {
            name: float(CONSTANTS[name].begin + np.exp(at))
            for name, at in zip(self.names, theta, strict=True)
        }

    def simulated(self, step: Floats) -> _Path:
        """Return the path a step away, from states to which the derivatives lead."""
        near = zip(self.path.results, self.ways, strict=True)
        starts = [point.state + step @ way for point, way in near]
        constants = self.constants(self.theta + step)
        return self.skin.path(self.readings.pressures, constants, starts)

    def of_path(self, path: _Path) -> Floats:
        """Return the readings of a path, (k, n)."""
        values = [[point[key] for point in path.values] for key in self.readings.values]
        return np.array(values)[:, self.where]

    def deviations(self, residuals: Floats) -> Floats:
        """Return the standard deviation of the readings of each column, (k, 1)."""
        left = 1 - self.free.sum() / self.seen.sum()
        squares = np.where(self.seen, residuals**2, 0.0).sum(axis=1) / self.seen.sum(axis=1)
        largest = np.nanmax(np.abs(self.readings.table), axis=1)
        return np.maximum(np.sqrt(squares / max(left, 0.1)), EXACT * largest)[:, None]

    def squares(self, path: _Path) -> float:
        """Return half the sum of squares of residuals over their deviations."""
        residuals = (self.readings.table - self.of_path(path)) / self.sigma
        return float(np.sum(residuals[self.seen] ** 2) / 2)

    def run(self) -> None:
        """Find the constants, and hold those that the readings do not tell."""
        try:
            self.path = self.skin.first(self.readings.pressures, self.constants(self.first))
        except EquilibriumError as caught:
            raise NoEquilibriumError(
                f"with the constants of the scene the skin has no equilibrium at each pressure: "
                f"{caught} Begin with others, a stiffer fabric for instance."
            ) from None
        for _ in range(MOST_STEPS):
            self.linearise()
            step = np.zeros(len(self.theta))
            step[self.free] = self.covariance @ (self.jacobian.T @ self.residuals)[self.free]
            size = np.abs(step[self.free]) / np.sqrt(np.diag(self.covariance))
            stuck = self.free & (self.theta >= self.most) & (step > 0)
            untold = self.untold(stuck) if size.max() < NEARLY or stuck.any() else None
            if untold is not None:
                self.hold(untold)
            elif size.max() < ENOUGH or not self.moved(
                step * min(1.0, LARGEST_STEP / np.abs(step).max())
            ):
                break

    def linearise(self) -> None:
        """Find the derivatives of the readings at the unknowns, over their deviations."""
        changed = []
        for k in range(len(self.theta)):
            further = self.theta.copy()
            further[k] += DIFFERENCE
            changed.append(self.constants(further))
        slopes, self.ways = self.skin.slopes(self.path, changed, [*self.readings.values])
        residuals = self.readings.table - self.of_path(self.path)
        self.sigma = self.deviations(residuals)
        of_readings = slopes[:, :, self.where] / self.sigma
        self.jacobian = of_readings[:, self.seen].T
        self.residuals = (residuals / self.sigma)[self.seen]

    @property
    def covariance(self) -> Floats:
        """Covariance of the unknowns that are free, (p, p), of independent readings."""
        of_free = self.jacobian[:, self.free]
        return np.asarray(np.linalg.pinv(of_free.T @ of_free, hermitian=True))

    def moved(self, step: Floats) -> bool:
        """Take as much of a step as makes the squares smaller; return whether some does."""
        before = self.squares(self.path)
        for part in 0.5 ** np.arange(HALVINGS):
            way = np.minimum(part * step, self.most - self.theta)
            with suppress(EquilibriumError):  # raised by all ranks or by none
                path = self.simulated(way)
                if self.squares(path) < before:
                    self.theta, self.path = self.theta + way, path
                    return True
        return False

    def hold(self, place: int) -> None:
        """Hold a constant at its first value, and let the others follow as they tell."""
        self.free[place] = False
        step = np.zeros(len(self.theta))
        step[place] = self.first[place] - self.theta[place]
        left = self.residuals - self.jacobian @ step
        step[self.free] = self.covariance @ (self.jacobian.T @ left)[self.free]
        try:
            self.path = self.simulated(step)
            self.theta = self.theta + step
        except EquilibriumError:
            self.theta = self.first.copy()
            self.path = self.skin.first(self.readings.pressures, self.constants(self.first))

    def untold(self, stuck: Bools) -> int | None:
        """Return the last constant that the readings do not tell, and note why; None without.

        Those that are stuck at their largest value are not told.
        """
        covariance = self.covariance
        error = np.sqrt(np.diag(covariance))
        alike = np.abs(covariance / np.outer(error, error))
        names = [name for name, free in zip(self.names, self.free, strict=True) if free]
        for k in reversed(range(len(names))):
            half, why = min(self.student * error[k], 50.0), ""
            if stuck[self.free][k]:
                why = f"the readings ask for more than {CONSTANTS[names[k]].most}"
            elif 2 * np.sinh(half) > 1:
                factor = f"{np.exp(half):.2g}"
                why = f"its interval would reach from 1/{factor} to {factor} times it"
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
        """Return the constants with their intervals.

        A constant that is held may be off by `HELD`, and the others move with it.
        """
        covariance, free = self.covariance, self.free
        gains = -covariance @ self.jacobian[:, free].T @ self.jacobian[:, ~free]
        whole = self.student**2 * covariance + np.log(HELD) ** 2 * gains @ gains.T
        half = np.zeros(len(free))
        half[free] = np.sqrt(np.diag(whole))
        values, low, high = map(self.constants, (self.theta, self.theta - half, self.theta + half))
        names = [name for name in self.names if name not in self.held]
        error = np.sqrt(np.diag(covariance))
        remarks = [
            f"{name} is not told, and held at {values[name]:.4g}: {self.held[name]}. Intervals "
            f"allow for {HELD - 1:.0%} more or less of it."
            for name in self.names
            if name in self.held
        ]
        return InflationFit(
            estimates={
                n: Estimate(values[n], low[n], high[n], True, CONSTANTS[n].unit) for n in names
            },
            keys=self.skin.keys(values),
            held={name: (values[name], why) for name, why in self.held.items()},
            correlations=covariance / np.outer(error, error),
            readings=self.readings,
            fitted=dict(zip(self.readings.values, self.of_path(self.path), strict=True)),
            simulations=self.skin.simulations - self.before,
            remarks=[*remarks, LIMITS],
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
        sizes = ["diameter [mm]"] if _sizes(scene) else []
        known = ", ".join([*sizes, *(metric.key for metric in metrics)])
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
    table = np.array([*columns.values()]).T.tolist()
    rows = [dict(zip(columns, row, strict=True)) for row in table]

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
        columns = zip(grid[0], readings.values.items(), COLOURS, strict=False)
        for axes, (key, values), colour in columns:
            axes.plot(readings.pressures / 1e3, values, ls="", marker=".", color=colour, alpha=0.6)
            axes.plot(readings.pressures / 1e3, result.fitted[key], color=colour, lw=1.8)
            axes.set(xlabel="pressure in kPa", ylabel=key.replace("_", " "))
            axes.grid(axis="y")
