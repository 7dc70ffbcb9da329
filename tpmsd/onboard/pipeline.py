"""The pure core, strung together: stamped inputs in, estimates and alarms out.

In: CAN frames and NMEA lines in the order of their host time stamps, and the passing of time. Out: a `Step`
per tick. No I/O, no clock: the daemon and the replay run this very class, so a recorded run replays to the
same alarms.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from cantools.database import Database
from numpy.typing import NDArray

from tpmsd.car.config.model import Config
from tpmsd.foundation.bounds import check_like, check_plain
from tpmsd.onboard.estimators.base import Estimator, RadiusEstimate
from tpmsd.onboard.estimators.build import build_estimator, monitored_wheels
from tpmsd.onboard.estimators.gates.guarded import GuardedEstimator
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import MonitorReport
from tpmsd.onboard.resonance.watch import ResonanceWatch
from tpmsd.onboard.sinks.explanation import Explanation
from tpmsd.onboard.sinks.reset_request import PREFIX, ResetRequest, from_frame, from_sentence
from tpmsd.onboard.sources.can.block import ERROR, REMOTE, FrameBlock
from tpmsd.onboard.sources.can.signal_plan import EXTENDED
from tpmsd.onboard.sources.events import Event
from tpmsd.onboard.sources.obd_speed import speed_answer_kmh
from tpmsd.onboard.timeline.block_source import BlockSource
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.car.vehicle_state.estimator import VehicleStateEstimator
    from tpmsd.car.vehicle_state.record import VehicleState
    from tpmsd.onboard.timeline.compensation import Compensation

REPEATED_S = 5.0
"""Frames that ask for a reset within so long after another are the same request."""


class Step(NamedTuple):
    """One tick and what was made of it."""

    tick: Tick
    estimate: RadiusEstimate
    report: MonitorReport
    vehicle_state: VehicleState | None = None
    """None where it is not asked for, or not known in this tick."""


class Pipeline:
    """Decoder, assembler, timeline, estimator and monitor of one car."""

    def __init__(self, config: Config, database: Database, model: ExtendedModel | None = None) -> None:
        """`model`: physics beyond rolling that is known of this car, to be taken out of the ticks."""
        self._compensation: Compensation | None = None
        if model is not None and len(model):
            # Imported where it is used: most cars do without.
            from tpmsd.onboard.timeline.compensation import Compensation, with_model_constants

            config = with_model_constants(config, model)
            self._compensation = Compensation(config, model)
        self._source = TickSource(config, database)
        self._blocks = BlockSource(self._source)
        self.decoder = self._source.decoder
        self.assembler = self._source.assembler
        self.timeline = self._source.timeline
        self._config = config
        wheels = list(monitored_wheels(config))
        self.estimator = GuardedEstimator(
            self._new_estimator, wheels, np.array(config.vehicle.wheel_radius_m)
        )
        flag = EXTENDED if config.alarms.extended_ids else 0
        self._reset_key = -1 if config.alarms.reset_id is None else config.alarms.reset_id | flag
        self._speed_keys: frozenset[int] = frozenset()
        self._speed_bus = config.obd.bus_number(config.can)
        if config.obd.speed:
            flag = EXTENDED if config.obd.extended_ids else 0
            self._speed_keys = frozenset(number | flag for number in config.obd.answer_ids)
        self._control_ids = np.array(sorted({self._reset_key} | self._speed_keys), dtype=np.int64)
        """Identifiers of frames that are for others than the decoder."""
        self._block: FrameBlock | None = None
        self._control_at: list[int] = []
        """Indices in the present block at which they stand."""
        self._reset_s = -math.inf
        self._on_tick: Callable[[Tick], object] | None = None
        self.vehicle_state = _vehicle_state(config)
        """None where it is not asked for."""
        calibration = config.calibration if config.calibration_holds else None
        self.monitor = Monitor(
            config.vehicle, config.monitor, monitored_wheels(config), config.tyre, calibration
        )
        self._explanation = Explanation(monitored_wheels(config), config.monitor)
        self.resonance: ResonanceWatch | None = None
        if config.monitor.resonance:
            self.resonance = ResonanceWatch(config.vehicle.wheel_radius_m)
            self.timeline.observe_rotations(self.resonance)

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Step]:
        """Process one CAN data frame; `bus` as in `CanDecoder.decode`."""
        steps = self._run(self._source.on_frame(time_s, arbitration_id, is_extended, data, bus))
        self._handle_control_frame(
            time_s, arbitration_id | EXTENDED if is_extended else arbitration_id, data, bus
        )
        return steps

    def on_frames(self, block: FrameBlock, start: int, stop: int, bus: NDArray[np.intp]) -> Iterator[Step]:
        """Process the data frames `start` to before `stop` of a block, as `on_frame` each in turn. `bus`
        (channels,): number of the bus of each channel."""
        if block is not self._block:
            data_frame = block.flags & (ERROR | REMOTE) == 0
            control_frames = np.flatnonzero(data_frame & np.isin(block.identifier, self._control_ids))
            self._block, self._control_at = block, control_frames.tolist()
        first = bisect_left(self._control_at, start)
        for place in self._control_at[first : bisect_left(self._control_at, stop, first)]:
            yield from self._run_each(self._blocks.on_frames(block, start, place + 1, bus))
            key, number = int(block.identifier[place]), int(bus[block.channel[place]])
            self._handle_control_frame(float(block.time_s[place]), key, block.payload(place), number)
            start = place + 1
        yield from self._run_each(self._blocks.on_frames(block, start, stop, bus))

    def on_sentence(self, time_s: float, line: bytes) -> list[Step]:
        """Process one NMEA line; return the steps of the ticks that it completes."""
        steps = self._run(self._source.on_sentence(time_s, line))
        if line.startswith(PREFIX) and (request := from_sentence(line)) is not None:
            self._reset(request)
        return steps

    def _handle_control_frame(self, time_s: float, key: int, data: bytes, bus: int) -> None:
        """Process a frame that is for others than the decoder; `key`: its identifier, marked if of 29
        bits."""
        if key == self._reset_key and bus == 0:
            self._asked(time_s, data)
        elif key in self._speed_keys and bus == self._speed_bus:
            kmh = speed_answer_kmh(data)
            if kmh is not None:
                self.monitor.note_car_speed(kmh)

    def _asked(self, time_s: float, data: bytes) -> None:
        """Note that a frame asks for a reset."""
        request = from_frame(data)
        # Frames that ask alike within seconds are one request.
        if request is not None and not 0.0 <= time_s - self._reset_s < REPEATED_S:
            self._reset_s = time_s
            self._reset(request)

    def _new_estimator(self) -> Estimator:
        """Return one that has learned nothing."""
        return build_estimator(self._config, lambda: np.random.default_rng(self._config.filter.seed))

    def _reset(self, request: ResetRequest) -> None:
        """Learn the tyres again, if the monitor agrees."""
        taken, _ = self.monitor.reset(request.tyres)
        if taken and self.resonance is not None:
            self.resonance.forget()

    def observe_ticks(self, on_tick: Callable[[Tick], object]) -> None:
        """Call `on_tick` with every tick as the timeline made it, before anything is taken out of it."""
        self._on_tick = on_tick

    def on_event(self, event: Event) -> list[Step]:
        """Process a source's own event (an interface that went down, a receiver unplugged)."""
        return self._run(self._source.on_event(event))

    def advance(self, time_s: float) -> list[Step]:
        """Advance to a time: end epochs, find time-outs, complete ticks."""
        return self._run(self._source.advance(time_s))

    def on_tick(self, tick: Tick) -> Step:
        """Process a tick made elsewhere: campaigns of simulated drives come without frames and sentences."""
        return self._run([tick])[0]

    def finish(self) -> list[Step]:
        """Return what the end of a recording completes."""
        return self._run(self._source.finish())

    def _run_each(self, ticks: Iterator[Tick]) -> Iterator[Step]:
        for tick in ticks:
            yield from self._run([tick])

    def _run(self, ticks: list[Tick]) -> list[Step]:
        steps: list[Step] = []
        for raw in ticks:
            if self._on_tick is not None:
                self._on_tick(raw)
            tick = raw if self._compensation is None else self._compensation.apply(raw)
            tick, estimate, agreement = self.estimator.step(tick)
            received = None if self.resonance is None else self.resonance.evidence_at(tick.time_s)
            report = self.monitor.update(tick, estimate, received, agreement)
            judged = self.monitor.judgement
            self._explanation.update(tick, estimate, agreement, received, judged, report)
            state = None if self.vehicle_state is None else self._state(self.vehicle_state, tick, estimate)
            steps.append(Step(tick, estimate, report, state))
        return steps

    def _state(
        self, estimator: VehicleStateEstimator, tick: Tick, estimate: RadiusEstimate
    ) -> VehicleState | None:
        """Return the vehicle state at the end of a tick."""
        vehicle = self._config.vehicle
        if tick.gap_s > 0.0:
            estimator.reset()
        speed = estimate.speed_mps
        if not math.isfinite(speed):
            rear = tick.rotation_rad[2:] * np.array(vehicle.wheel_radius_m[2:]) / tick.dt_s
            speed = float(rear.mean())
        steer = tick.steering_wheel_angle_rad / (vehicle.steering_ratio or math.nan)
        signals = tick.accel_long_mps2, tick.accel_lat_mps2, tick.yaw_rate_radps
        return estimator.step(tick.dt_s, *signals, steer, speed)

    def explain(self) -> dict[str, Any]:
        """Return the reasons of the alarms, or of there being none, up to the last tick."""
        return self._explanation.document(self.monitor)

    def snapshot(self) -> dict[str, Any]:
        """Return what was learned, as plain numbers for the state file."""
        saved = {"estimator": self.estimator.inner.snapshot(), "monitor": self.monitor.snapshot()}
        if self.resonance is not None:
            saved["resonance"] = self.resonance.snapshot()
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore a snapshot; ValueError if it does not fit this configuration (then nothing is restored)."""
        try:
            monitor, estimator = saved["monitor"], saved["estimator"]
        except (KeyError, TypeError) as error:
            raise ValueError(f"the saved state lacks a part: {error}") from error
        check_plain(saved)
        check_like(estimator, self._new_estimator().snapshot())
        before = self.monitor.snapshot()
        self.monitor.restore(monitor)
        try:
            self.estimator.restore(estimator)
        except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
            self.monitor.restore(before)
            raise ValueError(str(error)) from error
        if self.resonance is not None:
            try:
                self.resonance.restore(saved["resonance"])
            except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError):
                # Saved without it, or by another version: learned again, and the radii are kept.
                self.resonance.forget()


def _vehicle_state(config: Config) -> VehicleStateEstimator | None:
    """Return the estimator of the vehicle state if one is asked for; ConfigError if the car is not known
    enough.
    """
    settings, vehicle = config.vehicle_state, config.vehicle
    if settings.method is None:
        return None
    # Imported where it is used: most cars do without.
    from tpmsd.car.config.vehicle_state import check_vehicle_state
    from tpmsd.car.vehicle_state.configured import configured_car
    from tpmsd.car.vehicle_state.estimator import VehicleStateEstimator

    check_vehicle_state(config)
    car = configured_car(config.dynamics, vehicle.track_front_m, vehicle.track_rear_m, vehicle.driven_axle)
    rng = np.random.default_rng((config.filter.seed, 1))  # apart from the draws of the radius filter
    return VehicleStateEstimator(car, settings.method, rng, settings.particles, means=True)
