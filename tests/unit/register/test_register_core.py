"""Register core: the known tables of other computers."""

from swarmd.register.config import Config
from swarmd.register.core.known_registers import (
    Action,
    Forgotten,
    PublishedTable,
    PublishPartners,
    ReachedUnit,
    ReadRoutes,
    RegisterCore,
)
from swarmware.testing.virtual import VirtualTime
from swarmware.types.register import Application, ApplicationTable, PartnerTable

SECOND = 1_000_000_000


def table(
    platform: str, *, boot: int = 1, epoch: int = 1, version: int = 1, apps: int = 1
) -> ApplicationTable:
    applications = tuple(Application(f"app{n}", 1, 100 + n, 0) for n in range(apps))
    return ApplicationTable(platform, "main", boot, epoch, version, "register#1", 0, applications)


def names(core: RegisterCore, now_ns: int = 0) -> list[str]:
    return [unit.table.platform for unit in core.units(table("uav1"), {}, now_ns)]


def test_own_register_precedes_others_in_natural_order() -> None:
    core = RegisterCore("uav1", "main", Config())
    for platform in ("uav10", "uav2", "gcs"):
        core.on_table(PublishedTable(table(platform), 0), 0)
    assert names(core) == ["uav1", "gcs", "uav2", "uav10"]


def test_table_of_older_master_or_start_is_void() -> None:
    core = RegisterCore("uav1", "main", Config())
    core.on_table(PublishedTable(table("uav2", boot=2, epoch=5, version=3, apps=4), 0), 0)
    for older in (
        table("uav2", boot=1, epoch=9, version=9),
        table("uav2", boot=2, epoch=4, version=9),
        table("uav2", boot=2, epoch=5, version=2),
    ):
        core.on_table(PublishedTable(older, 0), 0)
    assert len(core.units(table("uav1"), {}, 0)[1].table.applications) == 4
    core.on_table(PublishedTable(table("uav2", boot=2, epoch=6, version=1, apps=0), 0), 0)
    assert core.units(table("uav1"), {}, 0)[1].table.applications == ()


def test_first_table_may_grow_without_new_number() -> None:
    core = RegisterCore("uav1", "main", Config())
    core.on_table(PublishedTable(table("uav2", apps=0), 0), 0)
    core.on_table(PublishedTable(table("uav2", apps=3), SECOND), SECOND)
    assert len(core.units(table("uav1"), {}, SECOND)[1].table.applications) == 3


def test_removed_platform_is_forgotten_and_known_at_return() -> None:
    core = RegisterCore("uav1", "main", Config())
    for platform in ("uav2", "uav3"):
        core.on_table(PublishedTable(table(platform), 0), 0)
    assert core.on_removal("uav2", SECOND)[0]
    assert names(core) == ["uav1", "uav3"]
    assert [unit.table.platform for unit in core.partners().units] == ["uav3"]
    assert not core.on_removal("uav2", SECOND)[0]
    core.on_table(PublishedTable(table("uav2"), 2 * SECOND), 2 * SECOND)
    assert names(core) == ["uav1", "uav2", "uav3"]


def test_what_others_say_about_us_is_not_taken() -> None:
    core = RegisterCore("uav1", "main", Config())
    core.on_table(PublishedTable(table("uav1", epoch=99), 0), 0)
    assert names(core) == ["uav1"]


def test_each_register_has_its_hops_and_its_age() -> None:
    core = RegisterCore("uav1", "main", Config())
    core.on_table(PublishedTable(table("uav2"), 1 * SECOND), 1 * SECOND)
    core.on_table(PublishedTable(table("uav3"), 4 * SECOND), 4 * SECOND)
    known = core.units(table("uav1"), {("uav3", "main"): 4}, 5 * SECOND)
    units = {unit.table.platform: unit for unit in known}
    assert (units["uav1"].hops, units["uav1"].age_s) == (0, 0.0)
    assert (units["uav2"].hops, units["uav2"].age_s) == (1, 4.0)
    assert (units["uav3"].hops, units["uav3"].age_s) == (4, 1.0)


class Register:
    """A register in virtual time, with reachable platforms and their tables."""

    def __init__(self, restored: PartnerTable | None = None) -> None:
        self.time = VirtualTime()
        self.core = RegisterCore("uav1", "main", Config(forget_s=600.0))
        if restored is not None:
            self.core.restore(restored, self.time.now_ns)
        self.driver = self.time.drive(self.core, self.perform)
        self.reached: dict[tuple[str, str], ReachedUnit] = {}
        self.boards: list[PartnerTable] = []
        self.forgotten: list[tuple[str, int]] = []
        self.looks = 0
        self.driver.feed()

    def take(self, *tables: ApplicationTable) -> None:
        for one in tables:
            self.driver.feed(self.core.on_table(PublishedTable(one, self.time.now_ns), self.time.now_ns))

    def perform(self, action: Action) -> None:
        match action:
            case ReadRoutes():
                self.looks += 1
                self.driver.feed(self.core.on_routes_read(self.reached, self.time.now_ns))
            case PublishPartners(partners):
                self.boards.append(partners)
            case Forgotten(platform):
                self.forgotten.append((platform, self.time.now_ns // SECOND))


def test_long_silent_platform_is_forgotten_without_route() -> None:
    register = Register()
    register.take(table("uav2"), table("uav3"))
    register.reached = {("uav3", "main"): ReachedUnit(1), ("uav9", "main"): ReachedUnit(1)}
    register.time.run_for(700)
    assert register.forgotten == [("uav2", 600)]
    assert names(register.core) == ["uav1", "uav3"]
    register.reached = {}
    register.time.run_for(700)
    assert register.forgotten == [("uav2", 600), ("uav3", 1300)]
    assert register.looks == 141, "every ten seconds, and nothing in between"


def test_forgotten_platform_is_known_again_unchanged() -> None:
    register = Register()
    register.take(table("uav2"))
    register.time.run_for(601)
    assert names(register.core) == ["uav1"]
    register.reached = {("uav2", "main"): ReachedUnit(1, PublishedTable(table("uav2"), 0))}
    register.time.run_for(10)
    assert names(register.core) == ["uav1", "uav2"]


def test_table_age_counts_from_creation() -> None:
    register = Register()
    register.take(table("uav2"))
    register.reached = {("uav2", "main"): ReachedUnit(1, PublishedTable(table("uav2"), 0))}
    register.time.run_for(100)
    register.take(table("uav2"))  # received again, unchanged
    register.time.run_for(25)
    (_, unit) = register.core.units(table("uav1"), {}, register.time.now_ns)
    assert unit.age_s == 125


def test_board_of_partners_is_written_on_change_only() -> None:
    register = Register()
    register.reached = {("uav2", "main"): ReachedUnit(1), ("uav3", "main"): ReachedUnit(3)}
    register.take(*(table(name) for name in ("uav3", "uav2")))
    register.time.run_for(1)
    (*_, board) = register.boards
    assert [(unit.table.platform, unit.hops) for unit in board.units] == [("uav2", 1), ("uav3", 3)]
    written = len(register.boards)
    register.time.run_for(3600)
    assert len(register.boards) == written, "ages are stamps: nothing is rewritten while nothing changes"
    register.reached["uav3", "main"] = ReachedUnit(2)
    register.time.run_for(10)
    assert [unit.hops for unit in register.boards[-1].units] == [1, 2]
    register.take(table("uav2", version=2, apps=3))
    register.time.run_for(1)
    assert len(register.boards[-1].units[0].table.applications) == 3
    assert len(register.boards) == written + 2


def test_many_changes_in_short_time_are_few_writes() -> None:
    register = Register()
    register.time.run_for(1)
    written = len(register.boards)
    for number in range(200):
        register.take(table(f"uav{number + 2}"))
        register.time.run_for(0.005)
    register.time.run_for(1)
    assert len(register.boards[-1].units) == 200
    assert len(register.boards) - written <= 8


def since_ns(register: Register) -> int | None:
    """Last instant at which the first partner was reachable, or None while it is reachable."""
    return register.boards[-1].units[0].unreachable_since_ns


def test_unreachable_partner_is_marked_then_removed() -> None:
    register = Register()
    register.reached = {("uav2", "main"): ReachedUnit(1)}
    register.take(table("uav2"))
    register.time.run_for(100)
    assert since_ns(register) is None
    register.reached = {}
    register.time.run_for(100)
    assert since_ns(register) == 100 * SECOND
    register.reached = {("uav2", "main"): ReachedUnit(2)}
    register.time.run_for(10)
    assert since_ns(register) is None
    register.reached = {}
    register.time.run_for(700)
    assert register.boards[-1] == PartnerTable()


def test_successor_continues_board_of_killed_register() -> None:
    former = Register()
    former.reached = {("uav2", "main"): ReachedUnit(1), ("uav3", "main"): ReachedUnit(2)}
    former.take(table("uav2", version=7), table("uav3"), table("uav4"))
    former.time.run_for(400)
    successor = Register(former.boards[-1])
    successor.time.run_for(0)
    assert names(successor.core) == ["uav1", "uav2", "uav3", "uav4"], "at once, before any table arrives"
    successor.take(table("uav2", version=6))
    successor.reached = former.reached
    successor.time.run_for(700)
    assert names(successor.core) == ["uav1", "uav2", "uav3"], "who is alive stays, who is gone goes"
    assert successor.boards[-1].units[0].table.version == 7


def test_board_of_partners_excludes_units_of_own_node() -> None:
    former = RegisterCore("uav2", "main", Config())
    former.on_table(PublishedTable(table("uav1"), 0), 0)
    register = Register(former.partners())
    register.time.run_for(1)
    assert register.boards == [PartnerTable()]
