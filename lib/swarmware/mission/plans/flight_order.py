"""Order in which a tool's vehicle flies the items of a plan, with all jumps carried out."""

from typing import Final

from swarmware.errors import MissionError
from swarmware.mission.plans.plan import Plan, PlanItem, Unsupported, unsupported

JUMP: Final = 177
ORDER_LIMIT: Final = 2_000
"""Maximum number of items that are flown, repetitions counted: their mission stays below its size limit."""


def flight_order(plan: Plan) -> tuple[tuple[PlanItem, ...], tuple[Unsupported, ...]]:
    """Items in the order of the flight, and the jumps that cannot be kept.

    A jump is taken as often as its count, then never again, as PX4 and ArduPilot do it.
    Raises: MissionError when the flight has too many items.
    """
    places = {item.number: index for index, item in enumerate(plan.items)}
    left: dict[int, int] = {}
    refused: list[Unsupported] = []
    for index, item in enumerate(plan.items):
        if item.command != JUMP:
            continue
        target, times = item.param(1), item.param(2)
        if target not in places:
            refused.append(unsupported(item, f"jumps to item {target:g}, which does not exist"))
        elif times < 0 or times != int(times):
            refused.append(unsupported(item, f"count {times:g}: a mission repeats a finite number of times"))
        else:
            left[index] = int(times)
    order: list[PlanItem] = []
    index, steps = 0, 0
    while index < len(plan.items):
        item = plan.items[index]
        steps += 1
        if steps > ORDER_LIMIT:
            message = f"more than {ORDER_LIMIT} items with all jumps; expected fewer repetitions"
            raise MissionError(f"{plan.file}:{item.line}: item {item.number}: {message}")
        if left.get(index):
            left[index] -= 1
            index = places[int(item.param(1))]
            continue
        if item.command != JUMP:
            order.append(item)
        index += 1
    return tuple(order), tuple(refused)
