"""The JSON document: a model, its damping law and its identification, read and written without loss."""
