"""The part on the host: files arrive whole or not at all, an armed vehicle is not stopped."""

import asyncio
import hashlib
import subprocess
from asyncio.subprocess import PIPE
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.unit.cli.fleet.hosts import HOST, content, order, push, read

from swarmctl.commands.fleet import agent, remote, ssh
from swarmctl.commands.fleet.agent import FleetRecord, HostAgent
from swarmctl.commands.fleet.plan import HostStatus
from swarmctl.membership.hosts import digest
from swarmctl.session.processes import identity
from swarmware.errors import ConfigError, Denied, InvalidInput, NotFound, SwarmError
from swarmware.runtime.filewriter import replace_file


def test_pushed_files_replace_last_push_and_keep_others(tmp_path: Path) -> None:
    first = content(tmp_path, broker=b"udp_port = 7001\n") | {"data/missions/m/mission.toml": b"m"}
    seen = push(tmp_path, first)
    assert (seen.configured, seen.running, seen.config) == (True, False, digest(first))
    assert (tmp_path / "data/missions/m/mission.toml").read_bytes() == b"m"
    (tmp_path / "etc/services/own.toml").write_text("x = 1\n")
    second = content(tmp_path, tree=b"")
    assert push(tmp_path, second).config == digest(second)
    left = sorted(path.name for path in (tmp_path / "etc/services").iterdir())
    assert left == ["own.toml", "tree.toml"]
    (tmp_path / "etc/services/tree.toml").write_text("# changed on the host\n")
    assert HostAgent(order(tmp_path, "status")).carry_out(b"").config != digest(second)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"config/services/broker.toml": b"udp_prot = 1\n"}, ConfigError),
        ({"config/services/brokr.toml": b""}, NotFound),
        ({"config/node.toml": b"platform = 3\n"}, ConfigError),
        ({"config/node.toml": b"\xff"}, ConfigError),
        ({"config/../../passwd": b""}, InvalidInput),
        ({"/etc/passwd": b""}, InvalidInput),
        ({"other": b""}, InvalidInput),
    ],
)
def test_files_that_the_daemons_would_refuse_change_nothing(
    tmp_path: Path, change: dict[str, bytes], error: type[SwarmError]
) -> None:
    before = content(tmp_path, broker=b"udp_port = 7001\n")
    push(tmp_path, before)
    with pytest.raises(error):
        push(tmp_path, content(tmp_path, tree=b"") | change)
    assert HostAgent(order(tmp_path, "status")).carry_out(b"").config == digest(before)
    assert not (tmp_path / "etc/services/tree.toml").exists()


def test_a_push_that_was_cut_off_changes_nothing(tmp_path: Path) -> None:
    before, after = content(tmp_path), content(tmp_path, tree=b"")
    push(tmp_path, before)
    packed = msgspec.msgpack.encode(after)
    for size in range(0, len(packed), 16):
        with pytest.raises(InvalidInput, match="incomplete"):
            HostAgent(order(tmp_path, "push", digest=digest(after))).carry_out(packed[:size])
    assert HostAgent(order(tmp_path, "status")).carry_out(b"").config == digest(before)


@pytest.mark.parametrize("killed_at", range(3))
def test_killed_push_is_completed_by_next_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, killed_at: int
) -> None:
    push(tmp_path, content(tmp_path, broker=b""))
    after = content(tmp_path, tree=b"", guard=b"")
    written: list[Path] = []

    def replace(path: Path, data: bytes, **how: Any) -> None:
        if path.suffix == ".toml":
            written.append(path)
            if len(written) > killed_at:
                raise KeyboardInterrupt
        original(path, data, **how)

    original: Callable[..., None] = replace_file
    with monkeypatch.context() as patch:
        patch.setattr(agent, "replace_file", replace)
        with pytest.raises(KeyboardInterrupt):
            push(tmp_path, after)
    assert HostAgent(order(tmp_path, "status")).carry_out(b"").config == ""
    ended = HostAgent(order(tmp_path, "stop")).carry_out(b"")
    assert ended.config == digest(after)
    assert not (tmp_path / "etc/services/broker.toml").exists()


@pytest.mark.parametrize(
    ("answer", "refused"),
    [(("info", True), "armed"), ((None, None), "does not answer"), (("info", False), "")],
)
def test_an_armed_vehicle_is_stopped_by_force_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: tuple[Any, Any], refused: str
) -> None:
    push(tmp_path, content(tmp_path))
    child = subprocess.Popen(["sleep", "60"])
    try:
        who = identity(child.pid)
        record = FleetRecord(pid=who.pid, start_ticks=who.start_ticks)
        (tmp_path / "etc/.fleet.json").write_bytes(msgspec.json.encode(record))

        async def answers(*_: object) -> tuple[Any, Any]:
            return answer

        class Status(HostAgent):
            def _status(self) -> HostStatus:
                return HostStatus(running=self._record().process.alive(), resume=self._record().resume)

        monkeypatch.setattr(HostAgent, "_answer", answers)
        if refused:
            with pytest.raises(Denied, match=refused):
                Status(order(tmp_path, "stop")).carry_out(b"")
            assert child.poll() is None
        ended = Status(order(tmp_path, "stop", force=bool(refused), resume=True)).carry_out(b"")
        assert (ended.running, ended.resume) == (False, True)
    finally:
        child.kill()
        child.wait()


def test_error_on_host_has_same_exit_code_here() -> None:
    def printed(text: bytes, code: int = 0, stderr: str = "") -> ssh.SshResult:
        return ssh.SshResult(code, text, stderr)

    good = remote.status_of(printed(b'{"installed": true, "from a later version": 1}'))
    assert good.installed
    with pytest.raises(Denied, match="uav1 is armed"):
        remote.status_of(printed(b'{"error": "uav1 is armed", "exit_code": 5}'))
    for text in (b"", b"no json", b"[]", b"3", b'{"error": 1}', b'{"installed": "x"}'):
        with pytest.raises(SwarmError, match="no space left"):
            remote.status_of(printed(text, 1, "x\nno space left"))


class Local(remote.Remote):
    """A host whose scripts run here."""

    async def _script(self, script: str, *words: str, stdin: bytes | None = None) -> None:
        words = ("sh", "-c", script, "sh", *words)
        done = await asyncio.create_subprocess_exec(*words, stdin=PIPE, stdout=PIPE, stderr=PIPE)
        _, stderr = await done.communicate(stdin or b"")
        if done.returncode:
            raise SwarmError(stderr.decode().strip())


def test_wheel_is_uploaded_whole_and_installation_recorded(tmp_path: Path) -> None:
    prefix = tmp_path / "a b"
    (host,) = read(HOST + f'prefix = "{prefix}"\npip = ["--find-links", "a folder"]\n')
    python = prefix / "bin/python"
    python.parent.mkdir(parents=True)
    calls, full = tmp_path / "calls", tmp_path / "full"
    python.write_text(
        f'#!/bin/sh\nprintf "%s|" "$@" >>{calls}\necho >>{calls}\ntest "$3" = --version || test ! -e {full}\n'
    )
    python.chmod(0o755)
    data = b"PK wheel"
    wheel = remote.Wheel("swarmware-2.whl", data, hashlib.sha256(data).hexdigest())
    target = Local(host, 5.0, 60.0)
    with pytest.raises(SwarmError, match="incomplete"):
        asyncio.run(target.upload(msgspec.structs.replace(wheel, data=data[:-1])))
    assert list((prefix / "wheel").iterdir()) == []
    asyncio.run(target.upload(wheel))
    full.touch()
    with pytest.raises(SwarmError):
        asyncio.run(target.install(wheel))
    assert not (prefix / "wheel/installed").exists()
    full.unlink()
    asyncio.run(target.install(wheel))
    assert (prefix / "wheel/installed").read_text().strip() == wheel.sum
    last = calls.read_text().splitlines()[-1]
    assert last.endswith(f"--find-links|a folder|{prefix}/wheel/swarmware-2.whl|")
