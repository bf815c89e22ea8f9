"""The report as one self-contained HTML file: without network access or scripts, with the pictures."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from swarmctl.terminal.output import show
from swarmlab.report.plot_data import NodeFigures, PlotData
from swarmlab.report.report import ExperimentReport, comparison

_STYLE: Final = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #1f2933; max-width: 62rem;
       margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .2rem; }
h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #e4e7eb; padding-bottom: .25rem; }
p.sub { color: #616e7c; margin-top: 0; }
.state { display: inline-block; padding: .1rem .7rem; border-radius: 1rem; font-weight: 600; color: white; }
.good { background: #00805c; } .bad { background: #b94a00; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .28rem .7rem; border-bottom: 1px solid #e4e7eb; }
th { color: #616e7c; font-weight: 600; }
td.n, th.n { text-align: right; white-space: nowrap; }
td.ours { font-weight: 600; } td.note { color: #616e7c; }
img { width: 100%; height: auto; } .wide { overflow-x: auto; font-size: .82rem; }
.wide td, .wide th { padding: .22rem .45rem; }
footer { margin: 3rem 0 1rem; color: #616e7c; font-size: .85rem; }
"""

_NODE_COLUMNS: Final = (
    "node", "mission", "sent kB/s", "received kB/s", "receipt ms", "slot error m", "clock p95 µs", "CPU %",
    "RSS MB", "clock offset s", "drift ppm", "restarts",
)  # fmt: skip


def page(
    data: PlotData, report: ExperimentReport, pictures: Mapping[str, bytes], remarks: Sequence[str]
) -> str:
    """The page; `pictures` maps a caption to PNG bytes, in their order."""
    state = ("good", "completed") if report.completed and not report.collisions else ("bad", "failed")
    rows = "".join(
        f"<tr><td>{escape(row.what)}</td><td class=n>{escape(row.paper)}</td>"
        f"<td class='n ours'>{escape(row.ours)}</td><td class=note>{escape(row.note)}</td></tr>"
        for row in comparison(report)
    )
    head = "".join(f"<th class={'n' if i > 1 else 't'}>{escape(c)}</th>" for i, c in enumerate(_NODE_COLUMNS))
    nodes = "".join(_node(node) for node in data.nodes)
    figures = "".join(
        f'<h2>{escape(caption)}</h2><img alt="{escape(caption)}" src="data:image/png;base64,'
        f'{b64encode(png).decode()}">'
        for caption, png in pictures.items()
    )
    notes = "".join(f"<li>{escape(remark)}</li>" for remark in remarks)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(data.title)}</title><style>{_STYLE}</style></head><body>
<h1>{escape(data.title)}</h1>
<p class=sub>{escape(data.subtitle)} <span class="state {state[0]}">{state[1]}</span></p>
{f"<ul>{notes}</ul>" if notes else ""}
<h2>Figures</h2>
<table><tr><th></th><th class=n>paper</th><th class=n>here</th><th></th></tr>{rows}</table>
{figures}
<h2>Nodes</h2>
<div class=wide><table><tr>{head}</tr>{nodes}</table></div>
<footer>Traffic is counted at the brokers' sockets between the command and the end of the last mission; a
multicast datagram counts once when sent and once at each receiver. True positions and true time are known
because vehicles and clocks are simulated; every clock starts within ±5 s and drifts within ±50 ppm. The
paper's figures are of its own 16 computers on a Gigabit switch. MCAP logs of every node lie beside this file.
</footer>
</body></html>
"""


def _node(node: NodeFigures) -> str:
    texts = (node.platform, node.outcome)
    numbers = (
        node.egress_kbps,
        node.ingress_kbps,
        node.receipt_ms,
        node.formation_error_m,
        node.clock_error_us,
        node.cpu_percent,
        node.rss_mb,
        node.offset_s,
        node.drift_ppm,
        node.restarts,
    )
    left = "".join(f"<td>{escape(text)}</td>" for text in texts)
    right = "".join(
        f"<td class=n>{'' if n is None else escape(show(float(f'{n:.3g}')))}</td>" for n in numbers
    )
    return f"<tr>{left}{right}</tr>"
