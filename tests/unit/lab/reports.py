"""The figures of a good run of a lab."""

from swarmlab.measure.host import HostInfo
from swarmlab.report.report import P95, ExperimentReport, MeanMax, Percentiles, Receipt, TrafficFigures

GOOD = ExperimentReport(
    nodes=16,
    ready_s=9.3125,
    completed=True,
    duration_s=120.123456,
    traffic=TrafficFigures(16.1, 1.01, 15.2),
    requests=45,
    notifications=123456,
    bytes_per_notification=88.8,
    command_to_receipt_ms=Percentiles(1.5, 3.3, 3.4),
    order_to_receipt_ms=Percentiles(0.5, 1.3, 1.4),
    receipts=(Receipt("ugv1", 1.5, 0.5), Receipt("uav1", 3.41234567, 1.4)),
    formation_error_m=MeanMax(0.21, 0.8),
    min_separation_m=1.9,
    collisions=0,
    frames_lost=2,
    log_frames=99999,
    log_gaps=0,
    clock_error_us=P95(22.25678),
    cpu_percent_of_core=MeanMax(5.1, 8.8),
    rss_mb=MeanMax(77, 81),
    pss_mb=MeanMax(34, 35),
    host=HostInfo("Some CPU", 2, "6.1", 0.1, 88.0, 12.0),
    last_answer_ms=5.6,
)
