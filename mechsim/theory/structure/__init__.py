"""Structure of a mechanism: degrees of freedom and their explanation, and Assur groups."""
