"""Structures and motions with right values: the rows of cases.toml."""

from case_tables import run_row, table_rows


@table_rows(__file__)
def test_a_result_has_its_right_values(row, mechsim):
    run_row(row, mechsim)
