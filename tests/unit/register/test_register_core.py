"""Register core: tables of other computers in, what is known out."""

from swarmd.register.core import RegisterCore
from swarmware.types.register import Application, ApplicationTable

SECOND = 1_000_000_000


def table(
    platform: str, *, boot: int = 1, epoch: int = 1, version: int = 1, apps: int = 1
) -> ApplicationTable:
    applications = tuple(Application(f"app{n}", 1, 100 + n, 0) for n in range(apps))
    return ApplicationTable(platform, "main", boot, epoch, version, "register#1", 0, applications)


def names(core: RegisterCore, now_ns: int = 0) -> list[str]:
    return [unit.table.platform for unit in core.units(table("uav1"), {}, now_ns)]


def test_our_own_register_comes_first_then_the_others_in_natural_order() -> None:
    core = RegisterCore("uav1", "main", forget_s=600)
    for platform in ("uav10", "uav2", "gcs"):
        assert core.on_table(table(platform), 0)
    assert names(core) == ["uav1", "gcs", "uav2", "uav10"]


def test_a_table_of_an_older_master_or_an_older_start_is_void() -> None:
    core = RegisterCore("uav1", "main", forget_s=600)
    core.on_table(table("uav2", boot=2, epoch=5, version=3, apps=4), 0)
    for older in (
        table("uav2", boot=1, epoch=9, version=9),
        table("uav2", boot=2, epoch=4, version=9),
        table("uav2", boot=2, epoch=5, version=2),
    ):
        assert not core.on_table(older, 0)
    assert len(core.units(table("uav1"), {}, 0)[1].table.applications) == 4
    assert core.on_table(table("uav2", boot=2, epoch=6, version=1, apps=0), 0)
    assert core.units(table("uav1"), {}, 0)[1].table.applications == ()


def test_what_others_say_about_us_is_not_taken() -> None:
    core = RegisterCore("uav1", "main", forget_s=600)
    assert not core.on_table(table("uav1", epoch=99), 0)
    assert names(core) == ["uav1"]


def test_hops_and_age_are_told_with_each_register() -> None:
    core = RegisterCore("uav1", "main", forget_s=600)
    core.on_table(table("uav2"), 1 * SECOND)
    core.on_table(table("uav3"), 4 * SECOND)
    units = {unit.table.platform: unit for unit in core.units(table("uav1"), {"uav3": 4}, 5 * SECOND)}
    assert (units["uav1"].hops, units["uav1"].age_s) == (0, 0.0)
    assert (units["uav2"].hops, units["uav2"].age_s) == (1, 4.0)
    assert (units["uav3"].hops, units["uav3"].age_s) == (4, 1.0)


def test_a_platform_not_heard_of_for_long_is_forgotten() -> None:
    core = RegisterCore("uav1", "main", forget_s=600)
    core.on_table(table("uav2"), 0)
    core.on_table(table("uav3"), 0)
    assert core.on_heard("uav3", 500 * SECOND)
    assert not core.on_heard("uav9", 500 * SECOND)
    assert core.deadline_ns() == 600 * SECOND
    assert core.on_timer(600 * SECOND) == ["uav2"]
    assert names(core) == ["uav1", "uav3"]
