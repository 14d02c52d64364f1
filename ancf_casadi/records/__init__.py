"""Measured records: what a sensor measured, at which times, and the files that hold it.

``measurement`` has the record of one sensor over time, and ``sensor`` says what the sensor measures and where.
"""
