"""Results of blocks by their label, for tests."""

from swarmware.mission.budget import Budget
from swarmware.mission.check import check_folder
from swarmware.mission.finding import Finding
from swarmware.mission.folder import from_files
from swarmware.mission.outcome import BlockOutcome, OutcomeKind
from swarmware.types.mission import MissionFile


def result(label: str) -> BlockOutcome:
    """The result `ok`, `timeout`, `cancelled` or `error:<kind>`."""
    end, _, error = label.partition(":")
    return BlockOutcome(OutcomeKind(end), error)


def findings(*texts: str, take: tuple[int, ...] = (), budget: Budget | None = None) -> list[Finding]:
    """Roles a, b, … with these missions; one platform each unless `take` says otherwise."""
    names = "abcd"[: len(texts)]
    manifest = 'name = "trial"\n' + "".join(
        f'[[roles]]\nname = "{name}"\nfile = "{name}.json"\nkinds = ["uav"]\ntake = {number}\n'
        for name, number in zip(names, take or (1,) * len(texts), strict=True)
    )
    files = [MissionFile(f"{name}.json", text) for name, text in zip(names, texts, strict=True)]
    return check_folder(from_files([MissionFile("mission.toml", manifest), *files], ""), budget=budget)
