"""All kinds of scenes by name: configuration, quick variant, design and simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from toros_fem.base.scene import Scene
from toros_fem.products.actuators.problem import CaseMaker
from toros_fem.products.actuators.run import summary_sentence
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.actuators.simulate import FILES, simulation_run, simulation_sentence
from toros_fem.products.gripper import gripper
from toros_fem.products.own_mesh import own_mesh
from toros_fem.products.tile_design import tile
from toros_fem.products.tiles import pulled_sheet
from toros_fem.products.tubes import bend, bend_twist, contract, inflate, twist
from toros_fem.products.tubes.tube import coarse_tube
from toros_fem.products.walker import walker


@dataclass(frozen=True)
class Action:
    """What can be done with a scene.

    Attributes:
        run: `run(comm, output, config, verbose=…)`, with a further argument for each name in
            `files`; writes into the folder and returns the summary. It is collective.
        sentence: Returns the result in a sentence, from the summary.
        files: Files or folders that it can take, with their help; each may be None.
    """

    run: Callable[..., dict[str, Any]]
    sentence: Callable[[dict[str, Any]], str]
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """A kind of scene.

    Attributes:
        name: Name in scene files.
        about: What it is, in one line.
        config: The configuration with its defaults.
        coarse: Returns the quick variant of a configuration.
        design: The design of a pattern; None if there is nothing to design.
        simulate: The simulation of a plain or given pattern; None if there is none.
        cases: `cases(comm, config, **files)`; returns what makes the case of an actuator on the
            mesh of a configuration, and the configuration of the whole design; None for other
            scenes.
        shown: Configuration of a new scene file; None takes the defaults.
        example_files: Files and folders that a new scene file names.
    """

    name: str
    about: str
    config: Scene
    coarse: Callable[[Any], Any]
    design: Action | None
    simulate: Action | None
    cases: Callable[..., tuple[CaseMaker[Any], Any]] | None = None
    shown: Scene | None = None
    example_files: Mapping[str, str] = field(default_factory=dict)

    @property
    def example(self) -> Scene:
        """Configuration of a new scene file."""
        return self.config if self.shown is None else self.shown

    @property
    def files(self) -> dict[str, str]:
        """Files or folders that one of its actions can take, with their help."""
        actions = [action for action in (self.design, self.simulate) if action is not None]
        return {name: text for action in actions for name, text in action.files.items()}


def _simulation(case: CaseMaker[Any], default: ActuatorScene) -> Action:
    return Action(simulation_run(case, default), simulation_sentence, FILES)


def _cases(case: CaseMaker[Any]) -> Callable[..., tuple[CaseMaker[Any], Any]]:
    return lambda comm, config: (case, config)


def _kinds() -> dict[str, Kind]:
    found = [
        Kind(
            "bend",
            "a tube that bends",
            bend.BendScene(),
            coarse_tube,
            Action(bend.run, summary_sentence),
            _simulation(bend.case, bend.BendScene()),
            _cases(bend.case),
        ),
        Kind(
            "bend-twist",
            "a tube that bends and twists at once",
            bend_twist.BendTwistScene(),
            coarse_tube,
            Action(bend_twist.run, summary_sentence),
            _simulation(bend_twist.case, bend_twist.BendTwistScene()),
            _cases(bend_twist.case),
        ),
        Kind(
            "contract",
            "a tube that shortens",
            contract.ContractScene(),
            coarse_tube,
            Action(contract.run, summary_sentence),
            _simulation(contract.case, contract.ContractScene()),
            _cases(contract.case),
        ),
        Kind(
            "twist",
            "a tube that twists",
            twist.TwistScene(),
            coarse_tube,
            Action(twist.run, summary_sentence),
            _simulation(twist.case, twist.TwistScene()),
            _cases(twist.case),
        ),
        Kind(
            "inflate",
            "a tube without reinforcement that swells",
            inflate.InflateScene(),
            inflate.coarse,
            None,
            Action(inflate.run, inflate.sentence),
        ),
        Kind(
            "walker",
            "an X-shaped robot that stands up or crawls",
            walker.WalkerScene(),
            walker.coarse,
            Action(walker.run, walker.sentence),
            _simulation(walker.case, walker.WalkerScene()),
            _cases(walker.case),
        ),
        Kind(
            "gripper",
            "a gripper whose fingers close on an object",
            gripper.GripperScene(),
            gripper.coarse,
            Action(gripper.run, gripper.sentence),
            _simulation(gripper.case, gripper.GripperScene()),
            _cases(gripper.case),
        ),
        Kind(
            "tile",
            "a periodic fabric of designed stiffness",
            tile.TileScene(),
            tile.coarse,
            Action(tile.run, tile.sentence),
            None,
        ),
        Kind(
            "tile-sheet",
            "a pull test of a sheet of tiles",
            pulled_sheet.TileSheetScene(),
            pulled_sheet.coarse,
            None,
            Action(
                pulled_sheet.run,
                pulled_sheet.sentence,
                {"tile": "output folder of a designed tile; none: a simple tile"},
            ),
        ),
        Kind(
            "own-mesh",
            "a skin of your own, from a mesh file",
            own_mesh.OwnMeshScene(),
            own_mesh.coarse,
            Action(own_mesh.run, summary_sentence, own_mesh.DESIGN_FILES),
            Action(own_mesh.simulate, simulation_sentence, own_mesh.SIMULATION_FILES),
            own_mesh.cases,
            shown=own_mesh.EXAMPLE,
            example_files={"mesh": "my.stl"},
        ),
    ]
    return {kind.name: kind for kind in found}


KINDS: Mapping[str, Kind] = MappingProxyType(_kinds())
