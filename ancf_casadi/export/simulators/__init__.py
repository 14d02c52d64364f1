"""The beam as a script or model file of other simulators: MuJoCo, PyElastica, Exudyn and Newton."""
