"""The document of a study: one HTML file, and its tables, figures and numbers as files beside it."""
