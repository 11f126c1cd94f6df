"""A small three-axis bench whose every number stands here, so that tests need no bundled model."""

from __future__ import annotations

from sim_backend.model import EffectEntry, Hardware, Mode, Model, Port, Ring

MODES = {"theta_x": (29.6, 4.7, 3.23e-4), "theta_y": (29.2, 4.7, 3.3e-4), "z": (20.07, 5.3, 0.099)}
"""Frequency in Hz, decay rate in 1/s, inertia in kg m² or kg."""


def bench_model(
    effects: tuple[EffectEntry, ...] = (),
    hardware: bool = True,
    *,
    peak_current_a: float = 9.0,
    end_stop_rad: float = 10e-3,
) -> Model:
    """Return one mode per axis behind three actuators and three heads on 30 mm."""
    units = {"theta_x": ("N m", "rad"), "theta_y": ("N m", "rad"), "z": ("N", "m")}
    drives = {"theta_x": "torque_x", "theta_y": "torque_y", "z": "force_z"}
    return Model(
        name="small bench",
        sample_rate_hz=10_000.0,
        inputs=[Port(name=drives[d], unit=units[d][0], dof=d) for d in MODES],
        outputs=[Port(name=d, unit=units[d][1], dof=d) for d in MODES],
        modes=[
            Mode(label=d, frequency_hz=f, decay_rate_1_s=s, input={drives[d]: 1.0 / m}, output={d: 1.0})
            for d, (f, s, m) in MODES.items()
        ],
        effects=list(effects),
        hardware=Hardware(
            actuators=Ring(names=["A1", "A2", "A3"], radius_m=0.03),
            sensors=Ring(names=["S1", "S2", "S3"], radius_m=0.03),
            force_constant_n_a=5.7,
            actuator_steepness_n_sqrt_w=7.9,
            peak_current_a=peak_current_a,
            continuous_force_n=9.0,
            end_stop_angle_rad=end_stop_rad,
            end_stop_z_m=0.5e-3,
            cold_finger_k=77.0,
            thermal_resistance_k_w=5.0,
            thermal_time_constant_s=600.0,
        )
        if hardware
        else None,
    )


NOISE = tuple(EffectEntry(effect="sensor-noise", where=head, parameters={"std": 5e-9}) for head in ("S1", "S2", "S3"))
