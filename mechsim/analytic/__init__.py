"""Analytic methods: closed forms and loop equations; no simulator."""
