"""The demos that simulate a skin under pressure, for benchmarks that run them again."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.base.config import Config
from toros_fem.products.gripper import gripper
from toros_fem.products.tubes import bend, bend_twist, contract, inflate, twist
from toros_fem.products.tubes.tube import coarse_tube
from toros_fem.products.walker import walker

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True)
class Demo:
    """A demo: its run, its default configuration, and its quick variant."""

    run: Callable[..., dict[str, Any]]
    config: Config
    coarse: Callable[[Any], Any]


DEMOS = {
    "inflate": Demo(inflate.run, inflate.InflateConfig(), inflate.coarse),
    "bend": Demo(bend.run, bend.BendConfig(), coarse_tube),
    "contract": Demo(contract.run, contract.ContractConfig(), coarse_tube),
    "twist": Demo(twist.run, twist.TwistConfig(), coarse_tube),
    "bend_twist": Demo(bend_twist.run, bend_twist.BendTwistConfig(), coarse_tube),
    "walker": Demo(walker.run, walker.WalkerConfig(), walker.coarse),
    "gripper": Demo(gripper.run, gripper.GripperConfig(), gripper.coarse),
}


def without_curve(config: Any) -> Any:
    """Return a configuration that leaves the curve over the pressure out, if it has one."""
    return config.updated(curve_pressure=None) if hasattr(config, "curve_pressure") else config


def value_of(summary: dict[str, Any], key: str) -> Any:
    """Return an entry of a summary; dots in the key go down into it."""
    found: Any = summary
    for name in key.split("."):
        found = found[name]
    return found
