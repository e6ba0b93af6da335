"""The scenes that ship with kaneflex, as TOML and CSV files."""
