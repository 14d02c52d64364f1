"""The JSON document of a model, its damping law and its identifications, written and read without loss."""
