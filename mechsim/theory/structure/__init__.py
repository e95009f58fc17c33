"""Structure of a mechanism: how many freedoms it has and why, and the Assur groups it is built of."""
