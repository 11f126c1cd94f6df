"""The one time loop: plant, effects, sensors and controllers, emitted for the structure of a bench.

Order within one sample k, which starts at time t_k:
 1. read: positions from the states, then sensor heads and readings with their effects;
 2. control: feedback, learning and feed-forward give the command held until t_{k+1};
 3. drive: command effects, delay, amplifiers (currents) with theirs, torques on the inputs;
 4. step: `substeps` exact zero-order-hold steps of every mode. Drive effects see the position extrapolated to
    mid-step, and torques that depend on motion are themselves extrapolated there (3/2 f_k - 1/2 f_{k-1}): the loop is
    second-order accurate for smooth effects at no cost.

Where a bench feeds a torque straight through to its readings they wait for the torque of their own sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from sim_backend.effects.base import Site
from sim_backend.kernel.applied_effects import emit_effects
from sim_backend.kernel.arguments import COPIED
from sim_backend.kernel.code import F64, I64, Cells, Number, added, index, repeated
from sim_backend.kernel.control import emit_commands
from sim_backend.kernel.emission import Emission
from sim_backend.kernel.tables import Tables
from sim_backend.linear import TAPS


class Sample(Emission):
    """Emits the loop of a structure."""

    def emit(self) -> ir.Module:
        """Return the module with the whole loop."""
        at, inlined = self.at, self.structure.inlined
        self.begin()
        rows = {"command": self.n_u, "torque": self.n_u, "current": self.n_a, "position": self.n_y}
        self.run = Tables(self, {**rows, "reading": self.n_y, "head": self.n_s, "temperature": 1})
        if inlined:
            self.copy(self.cells("reading"), self.bus["reading"], self.n_y)
        self.temperature, self.bus["source"][0] = self.cells("temperature"), self.zero
        self.bus["source"][1] = self.temperature[0]
        has_past = at.inttoptr(self.whole["has_past"], I64.as_pointer())
        self.half = self.local(1, "half")
        self.half[0] = self.alike(Number(at, at.sitofp(at.load(has_past), F64))) * 0.5
        heating = self.cells("heating")
        self.heating = (heating[0], heating[1] / heating[3], self.dt_s / heating[2])
        self._stretches()
        self.temperature[0] = self.bus["source"][1]
        played = at.select(at.icmp_signed(">", self.whole["n"], index(0)), index(1), at.load(has_past))
        for table in self.tables:
            at.store(played, at.inttoptr(table["has_past"], I64.as_pointer()))
        for name in COPIED[1:]:
            self.copy(self.mine[name], self.cells(name), self.sizes[name])
        if inlined:
            self.copy(self.bus["reading"], self.cells("reading"), self.n_y)
        at.ret_void()
        return self.module

    def _stretches(self) -> None:
        """Emit stretches of samples that end with the period, or where a gate opens or closes the feedback."""
        at, whole = self.at, self.whole
        done, k, event = (at.alloca(I64, name=name) for name in ("done", "k", "event"))
        for counter in (done, k, event):
            at.store(index(0), counter)
        head, body, end = (at.append_basic_block(name) for name in ("stretch", "samples", "end"))
        at.branch(head)
        at.position_at_end(head)
        at.cbranch(at.icmp_signed("<", at.load(done), whole["n"]), body, end)
        at.position_at_end(body)
        now, until = at.load(k), self.least(at.sub(whole["n"], at.load(done)), at.sub(whole["period"], at.load(k)))
        with at.if_then(at.icmp_signed(">", whole["n_events"], index(0))):
            names = ("n_events", "n_blocks", "events", "ctl.integrator", "ctl.fc", "xf", "closed")
            rows = [
                self.call("gate", [now, at.load(event), *(table[name] for name in names)], I64) for table in self.tables
            ]
            at.store(rows[0], event)
        self.copy(self.cells("xf"), self.mine["xf"], self.sizes["xf"])
        ahead = self.local(1, "ahead", lanes=1)
        ahead[0] = Number(at, at.sitofp(until, F64))
        with at.if_then(at.icmp_signed("<", at.load(event), whole["n_events"])):
            next_event = self.cells_of(whole, "events")[at.mul(at.load(event), index(4))]
            gap = next_event - Number(at, at.sitofp(now, F64))
            with at.if_then(at.fcmp_ordered("<", gap.value, ahead[0].value)):
                ahead[0] = gap
        until = self.run.most(at.fptosi(ahead[0].value, I64))
        closed = Cells(at, at.inttoptr(whole["closed"], I64.as_pointer()))
        self.closed = [at.icmp_signed("==", closed[i].value, index(1)) for i in range(self.n_u)]
        started = at.load(done)
        self.run.bring(started, until)
        with repeated(at, until, "sample") as i:
            self._sample(at.add(started, i), at.add(now, i), i)
        self.run.hand_back(started, until)
        self.copy(self.mine["xf"], self.cells("xf"), self.sizes["xf"])
        at.store(at.add(started, until), done)
        following = at.add(now, until)
        over = at.icmp_signed("==", following, whole["period"])
        at.store(at.select(over, index(0), following), k)
        at.store(at.select(over, index(0), at.load(event)), event)
        at.branch(head)
        at.position_at_end(end)

    def _sample(self, sample: Any, k: Any, i: Any) -> None:
        """Emit one sample."""
        structure = self.structure
        for column in range(structure.n_columns):
            self.bus["source"][2 + self.n_u + self.n_y + column] = self.run.drawn(column, sample, i)
        self._motion()
        if not structure.feedthrough:
            self._read()
        emit_commands(self, sample, k)
        self._drive(sample)
        if structure.heated:
            self._heat()
        self._torque()
        if structure.feedthrough:
            self._motion()
            self._read()
        self._record(sample, i)
        self._advance()
        if structure.fine:
            with repeated(self.at, self.at.sub(self.whole["substeps"], index(1)), "substep"):
                self._motion()
                self._torque()
                self._advance()

    def _motion(self) -> None:
        """Emit positions and rates from modal states and the torque in force, and what effects watch of them."""
        seen, mode, c, x = self.seen, self.seen_mode, self.weights["c"], self.mine["x"]
        acting = [self.mine["acting"][j] for j in range(self.n_u)]
        self.position, rate = [], []
        for i in range(self.n_y):
            states = [(s, x[2 * mode[s]], x[2 * mode[s] + 1]) for s in range(seen[i], seen[i + 1])]
            at = added([c.term((s, 1), v, c.term((s, 0), q, None)) for s, q, v in states])
            speed = added([c.term((s, 3), v, c.term((s, 2), q, None)) for s, q, v in states])
            self.position.append(self.weights["d"].row(i, acting, at) or self.zero)
            rate.append(self.weights["rate_d"].row(i, acting, speed) or self.zero)
            self.bus["source"][2 + self.n_u + i] = self.position[i]
        coordinates = self.weights["coordinates"]
        modes = range(coordinates.shape[1] - self.n_y)
        where = (*self.position, *(x[2 * m] for m in modes))
        speeds = (*rate, *(x[2 * m + 1] for m in modes))
        for n, values, name in ((self.bus_sizes["at"], where, "at"), (self.structure.n_rates, speeds, "speed")):
            for i in range(n):
                self.bus[name][i] = coordinates.row(i, values) or self.zero

    def _product(self, name: str, values: Sequence[Number], to: Cells) -> None:
        """Emit the product of a matrix with `values`."""
        for i in range(self.weights[name].shape[0]):
            to[i] = self.weights[name].row(i, values) or self.zero

    def _read(self) -> None:
        """Emit heads and readings from the positions."""
        self._product("to_heads", self.position, self.bus["head"])
        emit_effects(self, Site.HEAD)
        self._product("to_reading", [self.bus["head"][i] for i in range(self.n_s)], self.bus["reading"])
        emit_effects(self, Site.READING)

    def _drive(self, sample: Any) -> None:
        """Emit currents and the torques that they hold during this sample."""
        driven = self.bus["driven"]
        self.copy(self.bus["source"].part(2), driven, self.n_u)
        emit_effects(self, Site.COMMAND)
        values = [driven[j] for j in range(self.n_u)]
        if self.structure.delayed:
            values = [self._delayed(j, sample, value) for j, value in enumerate(values)]
        self._product("to_current", values, self.bus["current"])
        emit_effects(self, Site.CURRENT)
        current = [self.bus["current"][i] for i in range(self.n_a)]
        self.held = [self.weights["to_torque"].row(j, current) or self.zero for j in range(self.n_u)]

    def _delayed(self, j: int, sample: Any, value: Number) -> Number:
        """Emit the commands of an input's past that stand for the delayed one, weighted."""
        at, depth, weights = self.at, self.whole["depth"], self.cells("delay_taps").part(TAPS * j)
        queue = self.cells("queue").part(at.mul(index(j), depth))
        now = at.add(self.whole["samples"], sample)
        queue[at.srem(now, depth)] = value
        first = at.load(at.gep(at.inttoptr(self.whole["delay_first"], I64.as_pointer()), [index(j)]))
        # never below zero, for the queue is deeper than the delay
        newest = at.sub(at.add(now, depth), first)
        out = self.zero
        for i in range(TAPS):
            out = weights[i].times_plus(queue[at.srem(at.sub(newest, index(i)), depth)], out)
        return out

    def _heat(self) -> None:
        """Emit the temperature one sample on: first order towards cold finger + resistance × dissipated power."""
        cold_k, kelvin_per_square, share = self.heating
        square: Number | None = None
        for i in range(self.n_a):
            current = self.bus["current"][i]
            square = current * current if square is None else current.times_plus(current, square)
        now = self.bus["source"][1]
        aim = cold_k if square is None else kelvin_per_square.times_plus(square, cold_k)
        self.bus["source"][1] = share.times_plus(aim - now, now)

    def _torque(self) -> None:
        """Emit the torques on the structure for one substep."""
        torque, force = self.bus["torque"], self.bus["force"]
        for j in range(self.n_u):
            torque[j] = self.held[j]
        for c in range(self.structure.n_rates):
            self.bus["middle"][c] = (self.fine_s * 0.5).times_plus(self.bus["speed"][c], self.bus["at"][c])
        emit_effects(self, Site.DRIVE)
        forces = range(self.bus_sizes["force"])
        for m in forces:
            force[m] = self.zero
        emit_effects(self, Site.STRUCTURE)
        along = [force[m] for m in forces]
        pushed = [self._onward(along, j) for j in range(self.n_u + self.n_pushed)]
        for j in range(self.n_u):
            if (onward := pushed[j]) is not None:
                torque[j] = torque[j] + onward
            self.mine["acting"][j] = torque[j]
        self.pushed = pushed[self.n_u :]
        self.half[0] = self.constant(0.5)

    def _onward(self, forces: Sequence[Number], j: int) -> Number | None:
        """Emit what forces that depend on the motion do to input or mode `j`, extrapolated to mid-step."""
        moving: Number | None = None
        for m, force in enumerate(forces):
            moving = self.weights["levers"].term((m, j), force, moving)
        past = self.mine["past"]
        onward = None if moving is None else self.half[0].times_plus(moving - past[j], moving)
        past[j] = moving or self.zero
        return onward

    def _advance(self) -> None:
        """Emit the step of every mode under the held torque."""
        a, b, push, x = self.weights["a"], self.weights["b"], self.weights["push"], self.mine["x"]
        for m in range(self.n_modes):
            now = x[2 * m], x[2 * m + 1]
            for state in (0, 1):
                on = a.term((m, state, 1), now[1], a.term((m, state, 0), now[0], None))
                for d in range(self.driven[m], self.driven[m + 1]):
                    on = b.term((d, state), self.mine["acting"][self.driven_by[d]], on)
                if m < self.n_pushed and (force := self.pushed[m]) is not None:
                    on = push.term((m, state), force, on)
                x[2 * m + state] = on or self.zero

    def _record(self, sample: Any, i: Any) -> None:
        """Emit what is kept; a table without columns keeps nothing."""
        kept: dict[str, Sequence[Number]] = {
            "command": [self.bus["source"][2 + j] for j in range(self.n_u)],
            "torque": [self.bus["torque"][j] for j in range(self.n_u)],
            "current": [self.bus["current"][i] for i in range(self.n_a)],
            "position": self.position,
            "reading": [self.bus["reading"][i] for i in range(self.n_y)],
            "head": [self.bus["head"][i] for i in range(self.n_s)],
            "temperature": [self.bus["source"][1]],
        }
        for name, numbers in kept.items():
            columns = self.whole[f"columns.{name}"]
            with self.at.if_then(self.at.icmp_signed(">", columns, index(0)), likely=True):
                for row, number in enumerate(numbers):
                    self.run.keep(name, row, sample, i, number)
