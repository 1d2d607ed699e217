"""What worlds are furnished with: plants, rocks, buildings, vehicles; each drawn anew from a generator."""

from flowlik.simulation.things._buildings import facade_block, house
from flowlik.simulation.things._enclosures import OVAL, fence, garden_wall, hedge, railing
from flowlik.simulation.things._furniture import (
    billboard,
    bollard,
    gantry,
    guard_rail,
    street_lamp,
    traffic_sign,
)
from flowlik.simulation.things._plants import broadleaf, bush, conifer, fern, grass_tuft
from flowlik.simulation.things._rocks import rock
from flowlik.simulation.things._vehicles import Maker, car, lorry, van

__all__ = [
    "OVAL",
    "Maker",
    "billboard",
    "bollard",
    "broadleaf",
    "bush",
    "car",
    "conifer",
    "facade_block",
    "fence",
    "fern",
    "gantry",
    "garden_wall",
    "grass_tuft",
    "guard_rail",
    "hedge",
    "house",
    "lorry",
    "railing",
    "rock",
    "street_lamp",
    "traffic_sign",
    "van",
]
