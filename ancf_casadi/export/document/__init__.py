"""The JSON document of a model, its damping law and its identifications, written and read without loss.

``model_document`` reads and writes it, ``structs`` states its layout and ranges, from which the schema follows,
``identification`` holds the results of fits, and
``strict_json`` refuses what JSON readers tolerate.
"""
