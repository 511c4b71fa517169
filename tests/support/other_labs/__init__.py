"""Recordings of invented laboratories; shares no code with the product's simulator."""
