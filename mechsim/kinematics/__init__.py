"""Analytic methods: closed forms and loop equations, without a simulator."""
