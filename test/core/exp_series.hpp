#pragma once

#include "numeric.hpp"

namespace vi_ekf_slam::test {

/// exp(A) from its power series, scaled and squared, in long double: owes nothing to the closed forms.
LongMatrix expSeries(const LongMatrix& A);

/// The integral of exp(s A) over s in [0, 1], that is the sum of A^k / (k + 1)!: the left Jacobian for A =
/// ad.
LongMatrix integratedExpSeries(const LongMatrix& A);

} // namespace vi_ekf_slam::test
