"""The study of the paper: its file, its printed numbers, and the parts that no other study needs.

Such a part is a script: a function that states its tasks, if it has any, and one that makes its finding.
"""
