"""Tables of a scene file: which subject a field of a configuration belongs to."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from toros_fem.base.keys import Table

# Titles of the tables, in the order in which they are written.
TITLES: Mapping[str, str] = MappingProxyType(
    {
        "target": "Shape or stiffness that is asked for",
        "object": "What is gripped",
        "skin": "Sizes and mesh",
        "material": "Fabric, print and bladder",
        "pressure": "Pressure",
        "contact": "Contact and friction",
        "pull": "Pull test",
        "objective": "What counts in the objective",
        "design": "Steps, filter and start of the design",
        "lines": "Relaxed designs and their printable lines",
        "print": "Printer",
        "results": "What is simulated of the print",
    }
)
# Tables that a new file shows with their values; those of the others are shown as comments.
SHOWN = ("target", "object", "skin", "material", "pressure", "contact", "pull")

_FIELDS: Mapping[str, str] = MappingProxyType(
    {
        "target": "bend angle twist shorten neutral contraction keep_length length_ratio axis "
        "toward begin end motion aim reach bent_length wrap_angle tip_angle edge_bend_radius "
        "edge_angle tail_length inflated_depth target stiffness_0 stiffness_45 stiffness_90",
        "object": "shape mass object_mesh object_scale lift_distance slip_limit",
        "skin": "scale component refinements cuts method crease_angle max_stretch length diameter "
        "whole leg_length leg_width body_radius fillet foot_length finger_length finger_width "
        "root_length stem_length backbone_width size mesh edge_length",
        "material": "fabric_young poisson thickness c1 c2 reinforcement_young "
        "reinforcement_poisson reinforcement_thickness reinforcement_c1 reinforcement_c2 "
        "bending seams wrinkling print_side print_offset bladder_young bladder_thickness "
        "knit_ratio grain_angle fabric_mass print_mass",
        "pressure": "pressure design_pressure pressure_min pressure_max highest_pressure",
        "contact": "friction contact_distance feet pad_friction pad_length",
        "pull": "direction along across strain strain_steps margin",
        "objective": "counted metrics tip_weight orientation_length cross_sections axial_weight "
        "centreline_weight contact_weight holding_factor holding_weight",
        "design": "start seed starts levels iterations constrained_iterations min_decrease "
        "move_limit level_iterations level_move_limit polish_iterations corrections filter "
        "filter_radius beta eta line_width gap_width perimeter_weight perimeter_window "
        "perimeter_sharpness width_tolerance spread_weight trial_iterations draft_iterations "
        "finish_iterations correction_iterations tolerance constrained",
        "lines": "relaxed_edge_length relaxed_iterations directions share_limit share_weight "
        "smoothing_radius laid_width second_laid_width axial_width print_edge_length "
        "density_iterations",
        "print": "print_width island_area",
        "results": "estimate_error curve_pressure curve_steps gait_steps",
    }
)
_SECTION = {name: section for section, names in _FIELDS.items() for name in names.split()}
# Fields whose name means something else in some kinds.
_OTHERWISE = {
    ("inflate", "levels"): "pressure",
    ("gripper", "size"): "object",
    ("tile", "directions"): "target",
}


def sections_of(kind: str, config: Table) -> dict[str, tuple[str, ...]]:
    """Return the fields of a kind by the table they stand in, in the order of writing.

    Args:
        kind: Name of the kind.
        config: Its configuration.
    """
    order = {name: k for k, name in enumerate(_SECTION)}
    found: dict[str, list[str]] = {title: [] for title in TITLES}
    for name in sorted(config.described(), key=order.__getitem__):
        found[_OTHERWISE.get((kind, name), _SECTION[name])].append(name)
    return {section: tuple(names) for section, names in found.items() if names}
