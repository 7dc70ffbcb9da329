"""From a drive to an alarm: a simulated slow puncture, replayed, with its table and a plot.

    python docs/examples/from_a_drive_to_an_alarm.py

With your own recording: `drive = tpmsd.load("drives/monday")`.
"""

from __future__ import annotations

import tpmsd

nail = tpmsd.Fault("puncture", 2.0, wheel="rl", onset_s=90.0)  # 2 % of the radius within 30 s
drive = tpmsd.simulate(duration_s=160.0, seed=3, faults=(nail,))
replay = tpmsd.replay(drive)

for alarm in replay.alarms:
    after_s = alarm.time_s - replay.result.start_s - nail.onset_s
    print(f"{alarm.kind} {alarm.wheel} {alarm.state}, {after_s:.0f} s after the nail")

ticks = replay.to_pandas()
low = ticks[ticks["state_rl"] == "alarm"]
print(f"{len(ticks)} ticks, {len(low)} with the rear left tyre in alarm")
print(f"at the end {1e3 * low['change_rl_m'].iloc[-1]:+.1f} mm against its baseline")

axes = replay.plot()
axes.figure.savefig("alarm.png")
