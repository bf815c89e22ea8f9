"""A PWM chip of the kernel, simulated by files."""

from pathlib import Path


def chip(root: Path, channels: int = 2) -> Path:
    """A chip whose channels the kernel has made already."""
    folder = root / "pwmchip0"
    for channel in range(channels):
        (folder / f"pwm{channel}").mkdir(parents=True)
        for name in ("period", "duty_cycle", "enable"):
            (folder / f"pwm{channel}" / name).write_text("0\n")
    (folder / "export").touch()
    return folder


def number(folder: Path, name: str) -> int:
    lines = (folder / name).read_text().splitlines()
    return int(lines[0]) if lines else -1
