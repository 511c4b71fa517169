"""Drivers of real tables, all behind `read / drive / close`."""
