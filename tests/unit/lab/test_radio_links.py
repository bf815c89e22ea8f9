"""`lab link`, `cut`, `heal` and `partition`: which links are meant, what is sent, what is shown."""

import asyncio
import io
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.unit.lab.radio_rig import RadioRig

from swarmctl.commandline.settings import CliSettings
from swarmctl.session import labs, processes
from swarmctl.session.labs import LabNode, LabState
from swarmctl.terminal.output import Output
from swarmlab.radio import orders
from swarmlab.radio.core.link import ImpairmentChange
from swarmlab.radio.core.network import LinkReport
from swarmlab.radio.orders import CutLinks, HealLinks, ImpairLinks, OrderServer, RadioOrder
from swarmlab.run import links
from swarmware.errors import InvalidInput, NoAnswer, NotFound, OutOfRange, SwarmError
from swarmware.model.platform_kind import PlatformKind

NAMES = ("gcs", "ugv1", "uav1", "uav2", "uav2.nav")


def save_lab(folder: Path, radio_file: str) -> LabState:
    nodes = tuple(
        LabNode(
            platform=name,
            kind=PlatformKind("gcs" if name == "gcs" else name[:3]),
            folder=str(folder / "t" / "n" / name),
            shm_dir="/dev/shm/x",
            processes="one",
            offset_s=0,
            drift_ppm=0,
            pid=processes.identity(1).pid,
            pid_start=processes.identity(1).start_ticks,
        )
        for name in NAMES
    )
    (folder / "t").mkdir(parents=True)
    state = LabState(
        name="t", experiment="formation", net="netns", seed=1, folder=str(folder / "t"), created_utc_ns=1,
        starter=processes.identity(1), multicast_group="", udp_port=1, radio_file=radio_file, nodes=nodes,
    )  # fmt: skip
    labs.save(state)
    return state


class ServedRadio:
    """The order server of a lab in a thread; its orders reach a core without devices."""

    def __init__(self, folder: Path) -> None:
        self.rig = RadioRig(names=NAMES)
        self.got: list[RadioOrder] = []
        self._folder = folder
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        self._ready.wait(10)

    def _run(self) -> None:
        async def serve() -> None:
            async with OrderServer(self._folder, self._execute):
                self._ready.set()
                await self._ended.wait()

        self._loop.run_until_complete(serve())

    def _execute(self, order: RadioOrder) -> list[LinkReport]:
        self.got.append(order)
        found = [(NAMES.index(one), NAMES.index(other)) for one, other in order.links if one in NAMES]
        if len(found) < len(order.links):
            raise KeyError("uav9")
        match order:
            case ImpairLinks():
                self.rig.core.on_impairment(found, order.change, 0)
            case CutLinks():
                self.rig.core.on_cut(found, 0)
            case HealLinks():
                self.rig.core.on_heal(found, 0)
        return [self.rig.core.report(one, other, 0) for one, other in found]

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()
        self._loop.close()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SWARMCTL_LABS", str(tmp_path / "labs"))
    return labs.labs_folder()


@pytest.fixture
def radio(folder: Path) -> Iterator[ServedRadio]:
    save_lab(folder, "s3.toml")
    served = ServedRadio(folder / "t")
    yield served
    served.close()


def output() -> tuple[Output, io.StringIO]:
    text = io.StringIO()
    return Output(CliSettings(lab="t", output="json"), text, io.StringIO()), text


def directions(text: io.StringIO) -> list[str]:
    return [f"{link['sender']}>{link['receiver']}" for link in json.loads(text.getvalue())["links"]]


def test_impairment_is_set_in_both_directions_and_shown(radio: ServedRadio) -> None:
    out, text = output()
    links.impair("uav1", "gcs", ImpairmentChange(loss_ratio=0.3), out, one_way=False)
    found: dict[str, Any] = json.loads(text.getvalue())
    assert found["lab"] == "t"
    assert directions(text) == ["uav1>gcs", "gcs>uav1"]
    assert [link["impairment"]["loss_ratio"] for link in found["links"]] == [0.3, 0.3]


def test_one_way_impairs_named_direction_only(radio: ServedRadio) -> None:
    out, text = output()
    links.cut("uav1", "gcs", out, one_way=True)
    assert directions(text) == ["uav1>gcs"]
    assert radio.rig.report("gcs", "uav1").state == "up"


def test_missing_options_change_nothing_and_show_all(
    radio: ServedRadio,
) -> None:
    out, text = output()
    links.impair("", "", ImpairmentChange(), out, one_way=False)
    assert len(directions(text)) == 5 * 4
    assert [type(order).__name__ for order in radio.got] == ["ReadLinks"]


def test_platform_means_all_computers_and_patterns_work(radio: ServedRadio) -> None:
    out, text = output()
    links.cut("uav2", "ugv1", out, one_way=True)
    assert directions(text) == ["uav2>ugv1", "uav2.nav>ugv1"]
    out, text = output()
    links.cut("uav*", "gcs", out, one_way=True)
    assert directions(text) == ["uav1>gcs", "uav2>gcs", "uav2.nav>gcs"]


def test_partition_cuts_between_groups_and_rest(radio: ServedRadio) -> None:
    out, text = output()
    links.partition(("uav1,uav2",), out)
    apart = {tuple(pair.split(">")) for pair in directions(text)}
    inside, outside = {"uav1", "uav2", "uav2.nav"}, {"gcs", "ugv1"}
    assert apart == {(a, b) for a in inside for b in outside} | {(b, a) for a in inside for b in outside}
    out, text = output()
    links.heal("", "", out)
    assert all(radio.rig.report(a, b).state == "up" for a, b in apart)


@pytest.mark.parametrize("groups", [("uav1,gcs", "gcs"), ("*",)])
def test_groups_that_overlap_or_hold_everything_are_refused(
    radio: ServedRadio, groups: tuple[str, ...]
) -> None:
    with pytest.raises(InvalidInput, match=r"in two groups|all nodes are in one"):
        links.partition(groups, output()[0])


def test_unknown_node_and_link_to_itself_are_refused(radio: ServedRadio) -> None:
    with pytest.raises(NotFound, match="uav9"):
        links.cut("uav9", "", output()[0], one_way=False)
    with pytest.raises(InvalidInput, match="expected two different nodes"):
        links.cut("uav1", "uav1", output()[0], one_way=False)
    with pytest.raises(SwarmError, match=r"'uav9'.*no such node"):
        orders.send(Path(labs.find("t").folder), CutLinks((("uav9", "gcs"),)))


def test_table_has_settings_in_words_of_command(radio: ServedRadio) -> None:
    text = io.StringIO()
    change = ImpairmentChange(loss_ratio=0.3, delay_s=0.05, jitter_s=0.01, rate_bit_s=250_000)
    out = Output(CliSettings(lab="t"), text, io.StringIO())
    links.impair("uav1", "gcs", change, out, one_way=True)
    assert "loss 30 %, delay 50 ms, jitter 10 ms, rate 0.25 Mbit/s" in text.getvalue()


def test_lab_without_running_radio_is_named(folder: Path) -> None:
    state = save_lab(folder, "")
    with pytest.raises(InvalidInput, match=r"has no radio; expected a lab started with --net netns"):
        links.heal("", "", output()[0])
    labs.save(msgspec.structs.replace(state, radio_file="s3.toml"))
    with pytest.raises(NoAnswer, match=r"radio\.sock.*expected its process to run"):
        links.heal("", "", output()[0])


@pytest.mark.parametrize(
    "data", [b"\n", b"{}\n", b'{"type": "fly"}\n', b"\xff\xfe\n", b'{"type":"cut"}\n', b""]
)
def test_invalid_order_is_refused_and_next_executed(radio: ServedRadio, folder: Path, data: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(folder / "t" / orders.SOCKET))
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        answer = msgspec.json.decode(connection.makefile("rb").read(), type=orders.RadioAnswer)
    assert answer.refusal
    assert len(orders.send(folder / "t", HealLinks((("uav1", "gcs"),)))) == 1


@pytest.mark.parametrize(
    ("text", "expected"), [("1mbit", 1e6), ("250kbit", 250e3), ("1.5Mbit", 1.5e6), ("auto", 0), ("9bit", 9)]
)
def test_rates_are_typed_with_their_unit(text: str, expected: float) -> None:
    assert links.change(None, None, None, text) == ImpairmentChange(rate_bit_s=expected)


@pytest.mark.parametrize("text", ["", "1", "1m", "0mbit", "-1mbit", "mbit", "1 mbit/s"])
def test_other_rates_are_refused(text: str) -> None:
    with pytest.raises(InvalidInput, match="expected 1mbit, 250kbit or auto"):
        links.change(None, None, None, text)


def test_loss_is_percentage_with_or_without_its_sign() -> None:
    for text in ("30", "30%"):
        assert links.change(text, "50ms", "1s", None) == ImpairmentChange(
            loss_ratio=0.3, delay_s=0.05, jitter_s=1.0
        )
    with pytest.raises(InvalidInput, match="loss 'much': expected a percentage, such as 30"):
        links.change("much", None, None, None)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("130", None, None, None), "loss 130: expected 0 to 100 percent"),
        (("nan", None, None, None), "loss nan: expected 0 to 100 percent"),
        ((None, "2m", None, None), "delay 2m: expected at most 60s"),
        ((None, None, "61s", None), "jitter 61s: expected at most 60s"),
        ((None, None, None, "500gbit"), "rate 500gbit: expected at most 100gbit"),
    ],
)
def test_impossible_impairment_is_refused_before_sending(
    options: tuple[str | None, str | None, str | None, str | None], message: str
) -> None:
    with pytest.raises(OutOfRange, match=message):
        links.change(*options)


def test_a_partition_says_which_groups_it_has_made(radio: ServedRadio) -> None:
    messages = io.StringIO()
    out = Output(CliSettings(lab="t"), io.StringIO(), messages)
    links.partition(("uav1,ugv1", "uav2"), out)
    assert messages.getvalue() == "groups: ugv1,uav1 | uav2,uav2.nav | gcs\n"
