"""Constants from an inflated skin: shapes measured over pressure, and the simulation of that skin.

The unknowns θ are logarithms of the constants in the order of `Constant`. Gauss and Newton's method
finds the least squares. Each column of readings has a standard deviation of its own, that of its
residuals. Derivatives are those of the equilibria: K ∂q/∂θ = −∂F/∂θ with the tangent K and the
residual F, so a step costs one path and one factorisation for each pressure.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.special import stdtrit

from toros_fem.base.errors import FileError, NoEquilibriumError, ParameterError
from toros_fem.base.files import guarded, if_plotting, replace_file, write_json, write_table
from toros_fem.base.keys import DIMENSIONS, spelt
from toros_fem.base.scene import Scene, read_text
from toros_fem.base.validation import Bools, Floats
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes.skin import sew
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.actuators.simulate import case_to_simulate
from toros_fem.products.common.tables import SkinSheets
from toros_fem.products.fitting.columns import number_of
from toros_fem.products.fitting.fit import COLOURS, FILES, Estimate, r_squared
from toros_fem.products.fitting.samples import CONFIDENCE, FEWEST, correlation
from toros_fem.products.inflate import METRICS, InflateScene
from toros_fem.products.tubes import plain_tube

# Steps of Gauss and Newton's method, and halvings of a step that makes the squares larger.
MOST_STEPS, HALVINGS = 30, 4
# Largest change of an unknown by a step: no simulation starts far from what is known.
LARGEST_STEP = 0.3
# A step ends the iteration where it is this part of the standard errors; constants are held where
# it is the second part: by then it is clear which ones the readings do not tell.
ENOUGH, NEARLY = 0.03, 0.3
# Constants of the scene count as readings whose logarithms have this deviation: what the others
# tell it moves little, what they do not tell stays near.
START = 0.5
# So many readings a column has the deviation of all columns.
ALIKE_READINGS = 10
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
_HEADER = re.compile(r"(.*?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])])?")


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
        counts = [int(np.isfinite(values).sum()) for values in self.values.values()]
        if min(counts, default=0) < FEWEST:
            raise ParameterError(
                f"the columns have {counts} readings at pressures above 0; at least {FEWEST} are "
                "needed in each."
            )
        if not (self.pressures[0] > 0 and (np.diff(self.pressures) >= 0).all()):
            raise ParameterError("pressures must be above 0, and none below the one before.")

    @property
    def table(self) -> Floats:
        """The readings, (k, n)."""
        return np.array([*self.values.values()])


class MeasuredSkin:
    """A skin that was inflated: a plain tube, or an actuator with its print (collective).

    Args:
        scene: Sizes, mesh, and the constants to start from.
        pattern: Print of an actuator: folder of a design, its pattern, or a drawing.

    Raises:
        ParameterError: The scene is of no skin that is inflated.
        TorosError: The print cannot be read, or does not fit.

    Attributes:
        scene: As given.
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
        self._sheets: SkinSheets = scene.material
        self._skin, self._supports = sew(comm, plane), supports
        self._density = density[self._skin.owned_cells]

    def constants(self, readings: Readings) -> list[str]:
        """Return the constants that readings may tell."""
        if self.printed:
            return ["reinforcement_young", "fabric_young"]
        both = {"radius_percent", "length_percent"} <= readings.values.keys()
        isotropic = self._sheets.knit is None and self._sheets.wrinkling is None
        ratio = ["along_over_around"] * (both and isotropic)
        return ["fabric_young", *ratio, "c1", "c2", "poisson"]

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
        sheets = self._sheets
        return {n: 1.0 if n == "along_over_around" else getattr(sheets, n) for n in names}

    def _parts(self, constants: Mapping[str, float]) -> tuple[Any, ...]:
        return self._skin, self._sheets.updated(**self.keys(constants)).composite, self._supports

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
    ) -> tuple[Floats, Floats]:
        """Return by how much readings change with the constants, (p, k, n) (collective).

        The second are the changes of the states, (pressures, p, unknowns).

        Args:
            changed: Constants of which one differs by `DIFFERENCE` in its logarithm.
        """
        models = [make_model(*self._parts(values), **self._further) for values in changed]
        metrics = {metric.key: metric for metric in self.metrics}
        rows, ways = list[Any](), list[Any]()
        for point, values in zip(path.results, path.values, strict=True):
            for model in models:
                model.set_density(point.density)
                model.set_load(point.load)
                way = path.solver.solve_tangent(-model.residual(point.state), point)
                moved = self._skin.gather_vertices(model.positions(point.state + way))
                seen = [metrics[key].value(self._skin.pattern, moved) - values[key] for key in keys]
                rows.append(np.array(seen) / DIFFERENCE)
                ways.append(way / DIFFERENCE)
        shape = len(path.results), len(models), -1
        return np.moveaxis(np.reshape(rows, shape), 0, 2), np.reshape(ways, shape)


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
    remarks: Sequence[str]

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
            "held": {n: {"value": value, "why": why} for n, (value, why) in self.held.items()},
            "correlations": self.correlations.tolist(),
            "r2": self.quality(),
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


def fit_inflation(skin: MeasuredSkin, readings: Readings) -> InflationFit:
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

    def __init__(self, skin: MeasuredSkin, readings: Readings) -> None:
        self.skin, self.readings, self.before = skin, readings, skin.simulations
        self.names = names = skin.constants(readings)
        self.first = np.log([v - CONSTANTS[name].begin for name, v in skin.start(names).items()])
        self.most = np.log([CONSTANTS[name].most for name in names])
        self.free, self.held = np.ones(len(names), dtype=bool), dict[str, str]()
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
        """Return the standard deviation of the readings of each column, (k, 1).

        `ALIKE_READINGS` further ones have the deviation that all columns have over their largest.
        """
        largest = np.nanmax(np.abs(self.readings.table), axis=1)
        squares = np.where(self.seen, residuals**2, 0.0).sum(axis=1) / largest**2
        counts = self.seen.sum(axis=1)
        shared = squares.sum() / counts.sum() * ALIKE_READINGS
        left = max(1 - self.free.sum() / counts.sum(), 0.1)
        part = np.sqrt((squares + shared) / (counts + ALIKE_READINGS) / left)
        return (largest * np.maximum(part, EXACT))[:, None]

    def squares(self, path: _Path, far: Floats) -> float:
        """Return half the sum of squares of residuals over their deviations, and of the start's."""
        residuals = ((self.readings.table - self.of_path(path)) / self.sigma)[self.seen]
        return float(residuals @ residuals + far @ far / START**2) / 2

    def run(self) -> None:
        """Find the constants, and hold those that the readings do not tell."""
        try:
            self.begin()
        except EquilibriumError as caught:
            raise NoEquilibriumError(
                f"with the constants of the scene the skin has no equilibrium at each pressure: "
                f"{caught} Begin with others, a stiffer fabric for instance."
            ) from None
        for _ in range(MOST_STEPS):
            self.linearise()
            free, step = self.free, self.step(self.residuals)
            size = np.abs(step[free]) * np.sqrt(np.diag(self.precision))
            stuck = free & (self.theta >= self.most) & (step > 0)
            near = size.max() < NEARLY or stuck.any()
            if not near and self.moved(step):
                continue
            if (place := self.untold(stuck)) is not None:
                self.hold(place)
            elif size.max() < ENOUGH or not near or not self.moved(step):
                break
        else:
            raise FileError(
                f"the constants do not settle in {MOST_STEPS} steps: is the skin that of the "
                "scene, and are the units right?"
            )

    def step(self, residuals: Floats) -> Floats:
        """Return the step of the unknowns that are free, of Gauss and Newton's method."""
        free, step = self.free, np.zeros(len(self.theta))
        pull = self.jacobian.T @ residuals - (self.theta - self.first) / START**2
        step[free] = np.linalg.solve(self.precision + np.eye(free.sum()) / START**2, pull[free])
        return step * min(1.0, LARGEST_STEP / max(np.abs(step).max(), LARGEST_STEP))

    def begin(self) -> None:
        """Simulate the skin with the constants of the scene."""
        self.theta = self.first.copy()
        self.path = self.skin.first(self.readings.pressures, self.constants(self.theta))

    def linearise(self) -> None:
        """Find the derivatives of the readings at the unknowns, over their deviations."""
        changed = [self.constants(self.theta + way) for way in DIFFERENCE * np.eye(len(self.theta))]
        slopes, self.ways = self.skin.slopes(self.path, changed, [*self.readings.values])
        residuals = self.readings.table - self.of_path(self.path)
        self.sigma = self.deviations(residuals)
        of_readings = slopes[:, :, self.where] / self.sigma
        self.jacobian = of_readings[:, self.seen].T
        self.residuals = (residuals / self.sigma)[self.seen]

    @property
    def precision(self) -> Floats:
        """Inverse covariance of the unknowns that are free, (p, p), of independent readings."""
        of_free = self.jacobian[:, self.free]
        return np.asarray(of_free.T @ of_free)

    @property
    def covariance(self) -> Floats:
        """Covariance of the unknowns that are free, (p, p)."""
        return np.asarray(np.linalg.pinv(self.precision, hermitian=True))

    def moved(self, step: Floats) -> bool:
        """Take as much of a step as makes the squares smaller; return whether some does."""
        before = self.squares(self.path, self.theta - self.first)
        for part in 0.5 ** np.arange(HALVINGS):
            way = np.minimum(part * step, self.most - self.theta)
            with suppress(EquilibriumError):  # raised by all ranks or by none
                path = self.simulated(way)
                if self.squares(path, self.theta + way - self.first) < before:
                    self.theta, self.path = self.theta + way, path
                    return True
        return False

    def hold(self, place: int) -> None:
        """Hold a constant at its first value, and let the others follow as they tell."""
        self.free[place] = False
        back = self.first[place] - self.theta[place]
        step = self.step(self.residuals - self.jacobian[:, place] * back)
        step[place] = back
        try:
            self.path, self.theta = self.simulated(step), self.theta + step
        except EquilibriumError:
            self.begin()

    def untold(self, stuck: Bools) -> int | None:
        """Return the last constant that the readings do not tell, and note why; None without.

        Those that are stuck at their largest value are not told.
        """
        covariance = self.covariance
        error = np.sqrt(np.diag(covariance))
        alike = np.abs(_correlations(covariance))
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
        ends = self.theta - half, np.minimum(self.theta + half, self.most)
        values, low, high = map(self.constants, (self.theta, *ends))
        names = [name for name in self.names if name not in self.held]
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
            correlations=_correlations(covariance),
            readings=self.readings,
            fitted=dict(zip(self.readings.values, self.of_path(self.path), strict=True)),
            simulations=self.skin.simulations - self.before,
            remarks=[*remarks, LIMITS],
        )


def _correlations(covariance: Floats) -> Floats:
    error = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(error, error))


def read_inflation(path: Path | str, scene: Scene, metrics: Sequence[Metric]) -> Readings:
    """Return the readings of a table (one rank).

    The header names a pressure, and what was measured: of a tube `diameter [mm]` and `length [mm]`,
    of any skin its metrics by name and unit, `angle [deg]` or `angle_deg`. So curve.csv of a run is
    read as it is. Rows of pressure 0 are left out, and so are other columns.

    Raises:
        FileError: A line is wrong, or something is missing.
    """
    path = Path(path)
    lines = {
        k: line
        for k, line in enumerate(
            read_text(path, "a table of readings", "table").split("\n"), start=1
        )
        if line.strip() and not line.lstrip().startswith("#")
    }
    begin = min(lines, default=1)
    heading = lines.pop(begin, "")
    mark = next((one for one in ";\t," if one in heading), ",")
    columns, known = dict[int, tuple[str, float]](), _columns(scene, metrics)
    for place, cell in enumerate(heading.split(mark)):
        match = _HEADER.fullmatch(cell.strip().strip('"'))
        name, unit = match.groups("") if match else ("", "")
        if (name.lower(), spelt(unit)) in known:
            columns[place] = known[name.lower(), spelt(unit)]
        elif units := [of for word, of in known if word == name.lower()]:
            raise FileError(
                f"{path}, line {begin}: {name} is in {unit or 'no unit'!r}; write '{name} [UNIT]', "
                f"with one of {', '.join(units)}.", path, begin,
            )  # fmt: skip
    keys = [key for key, _ in columns.values()]
    if keys.count("pressure") != 1 or len(set(keys)) < max(2, len(keys)):
        names = ", ".join(sorted({word for word, _ in known}))
        raise FileError(
            f"{path}, line {begin}: a column 'pressure [kPa]' is needed, and once what was "
            f"measured; known are {names}. The header has {heading.strip()!r}.", path, begin,
        )  # fmt: skip
    rows = []
    for line, text in lines.items():
        cells, row = text.split(mark), dict.fromkeys(keys, np.nan)
        for place, (key, factor) in columns.items():
            cell = cells[place].strip() if place < len(cells) else ""
            row[key] = factor * number_of(cell, comma=mark != ",")
            if not np.isfinite(row[key]) and (cell or key == "pressure"):
                what = f"{path}, line {line}: {key} = {cell!r} is no finite number."
                raise FileError(what, path, line)
        rows.append(row)
    rows = sorted((row for row in rows if row["pressure"] > 0), key=lambda row: row["pressure"])
    values = {key: np.array([row[key] for row in rows]) for key in keys}
    try:
        return Readings(values.pop("pressure"), values)
    except ParameterError as caught:
        raise FileError(f"{path}: {caught}", path) from None


def _columns(scene: Any, metrics: Sequence[Metric]) -> dict[tuple[str, str], tuple[str, float]]:
    """Return key and factor of each column that is read, by its name and unit."""
    lengths, angles = (
        [(unit, float(by)) for unit, by in DIMENSIONS[of][1].items()] for of in ("m", "deg")
    )
    columns = {("pressure", u): ("pressure", float(by)) for u, by in DIMENSIONS["Pa"][1].items()}
    columns["pressure_pa", ""] = "pressure", 1.0
    for metric in metrics:
        columns[metric.key, ""] = metric.key, 1.0
        if metric.unit == "deg":
            columns |= {(metric.name, unit): (metric.key, by) for unit, by in angles}
            continue
        whole = 100.0 if metric.unit == "percent" else 1.0
        columns |= {(metric.name, u): (metric.key, by * whole) for u, by in (("%", 0.01), ("1", 1))}
        word = "diameter" if metric.name == "radius" else metric.name
        if size := getattr(scene.skin, word, None):
            columns |= {(word, unit): (metric.key, by * whole / size) for unit, by in lengths}
    return columns


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
