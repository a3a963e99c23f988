#include "vi_ekf_slam/core/map/saved_map.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "vi_ekf_slam/core/geometry/gaussian.hpp"
#include "vi_ekf_slam/core/geometry/so3.hpp"
#include "vi_ekf_slam/core/sensors/words.hpp"

namespace vi_ekf_slam {
namespace {

constexpr double kLargestMean = 1e3;       // m/s, rad/s, ..., of any variable
constexpr double kLargestVariance = 1e8;   // m^2, rad^2, ...: beyond it rounding alone is centimetres
constexpr double kRotationRounding = 1e-6; // largest element of R^T R - I
constexpr double kLatest = 4294967294.0;   // s, what a message's stamp can hold
constexpr double kSymmetry = 1e-9;         // of the standard deviations of row and column
// Of a correlation matrix's eigenvalues: what rounding leaves of exact zeros after a long drive.
constexpr double kCorrelationRounding = 1e-8;

/// All digits of it.
std::string text(double value) { return rounded(value, 17); }

template <typename Vector>
void requireWithin(const Vector& v, double limit, const std::string& source, const std::string& field) {
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    if (!(std::abs(v[i]) <= limit))
      refuse(source, field + "[" + std::to_string(i) + "]", text(v[i]),
             "finite numbers from " + rounded(-limit, 6) + " to " + rounded(limit, 6));
  }
}

bool isOfAName(char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_'; }

void validateLandmarks(const SavedMap& map, const std::string& source) {
  if (map.landmarks.size() > kMaxSavedLandmarks)
    refuse(source, "landmarks", std::to_string(map.landmarks.size()),
           "at most " + std::to_string(kMaxSavedLandmarks));
  std::unordered_set<FeatureId> ids;
  for (std::size_t i = 0; i < map.landmarks.size(); ++i) {
    const std::string field = "landmarks[" + std::to_string(i) + "]";
    if (!ids.insert(map.landmarks[i].id).second)
      refuse(source, field + ".id", std::to_string(map.landmarks[i].id), "every id once");
    requireWithin(map.landmarks[i].position, kMaxSavedDistance, source, field + ".position");
  }
}

/// Entry by entry, which bounds them, before a factorisation looks at all of them.
void validateEntries(const Eigen::MatrixXd& P, const std::string& source) {
  const auto entry = [](Eigen::Index row, Eigen::Index column) {
    return "covariance[" + std::to_string(row) + "][" + std::to_string(column) + "]";
  };
  const std::string bounds = "from 0 to " + text(kLargestVariance);
  for (Eigen::Index i = 0; i < P.rows(); ++i) {
    if (!(P(i, i) >= 0.0 && P(i, i) <= kLargestVariance)) refuse(source, entry(i, i), text(P(i, i)), bounds);
  }
  const Eigen::VectorXd sigma = P.diagonal().cwiseSqrt();
  for (Eigen::Index column = 0; column < P.cols(); ++column) {
    for (Eigen::Index row = column + 1; row < P.rows(); ++row) {
      const double most = sigma[row] * sigma[column];
      if (!(std::abs(P(row, column)) <= (1.0 + kCorrelationRounding) * most))
        refuse(source, entry(row, column), text(P(row, column)),
               "at most " + text(most) + ", as the diagonal has it");
      if (!(std::abs(P(row, column) - P(column, row)) <= kSymmetry * most))
        refuse(source, entry(column, row), text(P(column, row)),
               text(P(row, column)) + ", as symmetry has it");
    }
  }
}

} // namespace

void refuse(const std::string& source, const std::string& field, const std::string& value,
            const std::string& allowed) {
  throw MapError(source + ": " + field + " is " + value + ", allowed: " + allowed);
}

Eigen::Index SavedMap::base() const {
  Eigen::Index rows = 6;
  for (const SavedVariable& variable : variables) rows += variable.mean.size();
  return rows;
}

void validate(const std::vector<SavedVariable>& variables, const std::string& source) {
  if (variables.size() > kMaxSavedVariables)
    refuse(source, "variables", std::to_string(variables.size()),
           "at most " + std::to_string(kMaxSavedVariables));
  std::unordered_set<std::string> names;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    const auto& [name, mean] = variables[i];
    const std::string field = "variables[" + std::to_string(i) + "]";
    if (name.empty() || name.size() > kMaxSavedName || !std::all_of(name.begin(), name.end(), isOfAName)) {
      refuse(source, field + ".name", "of " + std::to_string(name.size()) + " characters",
             "1 to " + std::to_string(kMaxSavedName) + " of a to z, 0 to 9 and _");
    }
    if (!names.insert(name).second) refuse(source, field + ".name", name, "every name once");
    const auto size = static_cast<std::size_t>(mean.size());
    if (size == 0 || size > kMaxSavedRows)
      refuse(source, field + ".mean", "of " + std::to_string(size) + " numbers",
             "1 to " + std::to_string(kMaxSavedRows) + " numbers");
    requireWithin(mean, kLargestMean, source, name);
  }
}

void validate(const SavedMap& map, const std::string& source) {
  const double seconds = toSeconds(map.stamp);
  if (!(map.stamp > 0 && seconds < kLatest))
    refuse(source, "stamp", text(seconds), "from 1e-9 to " + text(kLatest) + " s");
  requireWithin(map.world_T_imu.translation(), kMaxSavedDistance, source, "pose.position");
  if (!map.world_T_imu.rotation().allFinite() ||
      !so3::isRotation(map.world_T_imu.rotation(), kRotationRounding))
    refuse(source, "pose.orientation", "no rotation", "a quaternion of norm 1");
  validate(map.variables, source);
  validateLandmarks(map, source);
  const Eigen::Index rows = map.rowOf(map.landmarks.size());
  if (map.covariance.rows() != rows || map.covariance.cols() != rows) {
    refuse(source, "covariance",
           std::to_string(map.covariance.rows()) + " x " + std::to_string(map.covariance.cols()),
           std::to_string(rows) + " x " + std::to_string(rows) + " for its variables and landmarks");
  }
  validateEntries(map.covariance, source);
  if (!isPositiveSemidefinite(map.covariance, kCorrelationRounding))
    refuse(source, "covariance", "not positive semidefinite",
           "a covariance: symmetric, positive semidefinite");
}

} // namespace vi_ekf_slam
