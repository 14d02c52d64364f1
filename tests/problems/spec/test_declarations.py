"""Tables of files and arguments in Python that mean the same have the same names and defaults."""

import inspect
import math
from dataclasses import fields
from typing import Any, get_args

import msgspec
import pytest
from msgspec import NODEFAULT, UNSET

from ancf_casadi import PointLoad, SampledLoad, Sensor, simulate, static_equilibrium
from ancf_casadi.damping.spec import FrictionSpec, ModalSpec, QuadraticSpec, RayleighSpec
from ancf_casadi.mechanics.spec import AttachmentSpec, BeamSpec, ConfigurationSpec, SupportSpec
from ancf_casadi.response.tracing import frequency_response
from problems import FrequencyRecord, MotionRecord, PlannedRecord, ResponseRecord, StaticRecord, fit_beam
from problems.beam.motions.record import Channel
from problems.spec import motion, plan, record_files, records

OBJECTS = [*get_args(SupportSpec), *get_args(AttachmentSpec), RayleighSpec, QuadraticSpec, FrictionSpec, ModalSpec]
SAME: list[tuple[Any, Any, set[str]]] = [  # a declaration, what its keys are arguments of, and keys that are none
    *((spec, spec.described, {"drag_coefficient", "air_density"} & set(spec.__struct_fields__)) for spec in OBJECTS),
    (motion.SimulationSpec, simulate, set()),
    (motion.ReleaseSpec, static_equilibrium, set()),
    (motion.ResponseSpec, frequency_response, {"base_amplitudes", "tip_forces", "direction", "modes", "tolerance"}),
    (record_files.SensorSpec, Sensor, {"sensor"}),
    (record_files.ChannelSpec, Channel, set(record_files.ColumnSpec.__struct_fields__)),
    (records.MotionSpec, MotionRecord, {"release"}),
    (records.CurveSpec, ResponseRecord, set()),
    (records.CurveValuesSpec, ResponseRecord, set()),
    (record_files.CurveFileSpec, ResponseRecord.from_file, {"imaginary", *record_files.RecordFile.__struct_fields__}),
    (records.StaticSpec, StaticRecord, {"channels"}),
    (records.LoadsSpec, StaticRecord, set()),
    (records.FrequenciesSpec, FrequencyRecord, set()),
    (records.FitSpec, fit_beam, {"laws"}),
    (plan.PlannedMotionSpec, PlannedRecord.motion, {"channels", "base", "load", "release", "start", "release_time"}),
    (records.StaticTestSpec, PlannedRecord.static, {"channels"}),
    (plan.PlannedFrequenciesSpec, PlannedRecord.natural_frequencies, set()),
]  # fmt: skip


@pytest.mark.parametrize(("declared", "function", "others"), SAME, ids=lambda value: getattr(value, "__name__", ""))
def test_keys_are_arguments_with_the_same_defaults(declared, function, others):
    arguments = inspect.signature(function).parameters
    for field in msgspec.structs.fields(declared):
        if field.name in others:
            continue
        assert field.name in arguments, field.name
        usual, default = arguments[field.name].default, field.default
        if default is NODEFAULT:
            assert usual is inspect.Parameter.empty or field.name in ("force", "loads"), field.name
        elif default is not UNSET and usual is not inspect.Parameter.empty:
            same = {None: (None, math.inf, math.nan), (): ((), None)}.get(default, (default,))
            assert usual in same or default in ((), None), (field.name, usual, default)


@pytest.mark.parametrize(
    ("declared", "made", "others"),
    [
        (records.LoadSpec, PointLoad, set()),
        (records.LoadColumnsSpec, PointLoad, set()),
        (motion.LoadValues, SampledLoad, set()),
        (record_files.SensorSpec, Sensor, {"quantity", "signal_unit"}),
        (record_files.ChannelSpec, Channel, {"measurement"}),
        *((spec, spec.described, {"modes"}) for spec in OBJECTS),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_every_field_of_an_object_is_a_key(declared, made, others):
    assert {field.name for field in fields(made)} - others <= set(declared.__struct_fields__)


def test_what_differs_between_two_measurements_of_a_beam_are_keys_of_the_beam():
    assert set(ConfigurationSpec.__struct_fields__) <= set(BeamSpec.__struct_fields__)
