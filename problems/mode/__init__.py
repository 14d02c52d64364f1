"""One mode of vibration from decays and response curves together, without a model of the structure."""
