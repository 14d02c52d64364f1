"""Harmonic balance, and the continuation of its solutions."""
