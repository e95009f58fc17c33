"""Values that count as rounding, for all packages."""

# spacing of floating-point numbers at 1
EPS = 2.0**-52
# largest residual of closed loops, in [rad] and characteristic lengths: Newton's method ends at about 1e-15
CLOSED = 1e-12
# difference of computed numbers, relative or in [rad], that is rounding: quantities of loops closed to 1e-12
# lose up to three digits by conditioning, and real differences are far larger
ROUNDING = 1e-9
# smallest divisor, which avoids a division by zero
TINY = 1e-300
