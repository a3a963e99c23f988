#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "vi_ekf_slam/core/filter/linear_measurement.hpp"
#include "vi_ekf_slam/core/geometry/se3.hpp"

namespace vi_ekf_slam {

/// In which coordinates a variable's error is. With the body's pose (R, p) and theta the error of its
/// rotation (right-invariant error of Barrau and Bonnabel, arXiv:1510.06263, about the body's position
/// instead of the world's origin, so that no number grows with the distance from there):
enum class Chart : std::uint8_t {
  kPose,        ///< 6 rows (dp, theta): p = p^ + dp, R = Exp(theta) R^; the first variable, and only that
  kVector,      ///< x = x^ + dx: twists, calibration
  kWorldVector, ///< 3 rows: v = Exp(theta) (v^ + e), a velocity along the world's axes
  kPoint,       ///< 3 rows: x - p = Exp(theta) (x^ - p^ + y), a point of the world
  /// 3 rows each: x = x^ + R^T R^ dx, along the body's axes. A correction of R leaves its error where it is
  /// in the world ("two frames": Barrau and Bonnabel, The geometry of navigation problems, IEEE TAC 2023).
  kBodyVector,
};

/// Names a variable from the time when it is added until it is removed.
using Handle = std::uint32_t;

/// Where a point is corrected in other coordinates than straight ones: from the corrected body to the point
/// (world axes, m), and how the error is re-expressed there, y <- M (y + seen x) + N x of others.
struct MovedPoint {
  Eigen::Vector3d way;
  Eigen::Matrix3d M;
  LinearFunction N;
};
/// Given by how the body was turned (R' = turn R), the way from the corrected body to the point that is not
/// corrected yet, and its correction d as it is seen to first order, all along the world's axes.
struct PointChart {
  using Move = std::function<std::optional<MovedPoint>(const Eigen::Matrix3d& turn,
                                                       const Eigen::Vector3d& way, const Eigen::Vector3d& d)>;
  /// By what errors of others (calibration) move a point as it is seen, on this way from the body.
  using Seen = std::function<LinearFunction(const Eigen::Vector3d& way)>;
  explicit operator bool() const { return static_cast<bool>(move); }

  Move move{};
  Seen seen{}; ///< none: by nothing
  /// By which the correction of others alone turns the points about the body as they are seen, rad, world.
  Eigen::Vector3d seen_turn = Eigen::Vector3d::Zero();
};

/// The variables of a filter: their means, and the rows of the error vector that each has, one after the
/// other from the pose on.
class Variables {
 public:
  explicit Variables(const SE3& pose);

  /// A new last variable. `mean` has as many entries as its error has rows. `name`: none, or its own alone.
  Handle add(Chart chart, const Eigen::VectorXd& mean, const std::string& name = {});

  /// The rows [row, row + size) are gone. What lay in [from, from + size) lies there now (the last variable,
  /// of the same size), or, where `shifts`, everything behind moved up.
  struct Gone {
    Eigen::Index row, size, from;
    bool shifts;
  };
  enum class Fate {
    kForgotten,
    kKeepsHandle, ///< until restore or release
  };
  Gone remove(Handle handle, Fate fate = Fate::kForgotten);
  /// A handle of a variable that has no rows, as one that was removed and keeps its handle.
  Handle reserve(Chart chart);
  /// Gives such a variable rows again, as the last one.
  void restore(Handle handle, const Eigen::VectorXd& mean);
  void release(Handle handle) { free_.push_back(handle); }

  Eigen::Index rows() const { return rows_; }
  Eigen::Index rowOf(Handle handle) const { return slots_[handle].row; }
  Eigen::Index sizeOf(Handle handle) const { return slots_[handle].size; }
  Chart chartOf(Handle handle) const { return slots_[handle].chart; }
  bool contains(Handle handle) const { return handle < slots_.size() && slots_[handle].size > 0; }
  /// All of them, by their rows.
  const std::vector<Handle>& handles() const { return order_; }
  /// By its name; nothing where there is none.
  std::optional<Handle> find(const std::string& name) const;
  /// Those that have a name, in the order in which they were added.
  struct Named {
    std::string name;
    Handle handle;
  };
  const std::vector<Named>& named() const { return named_; }

  const SE3& pose() const { return pose_; }
  void setPose(const SE3& pose) { pose_ = pose; }
  /// Whether gravity acts, whose direction is the world's: there is a velocity in the world. Then only where
  /// the body is and its heading are free.
  bool isLevel() const;
  /// Of any variable but the pose.
  auto mean(Handle handle) const { return mean_.segment(rowOf(handle), sizeOf(handle)); }
  auto mean(Handle handle) { return mean_.segment(rowOf(handle), sizeOf(handle)); }
  Eigen::Vector3d point(Handle handle) const { return mean_.segment<3>(rowOf(handle)); }

  /// Three rows whose error was re-expressed: y <- M y + N x of others, which are not re-expressed.
  struct Reexpressed {
    Eigen::Index row;
    Eigen::Matrix3d M;
    LinearFunction N{};
  };
  /// Moves the variables of the first `rows` rows by their error; points as `chart` has it, where it is given
  /// and defined. What became of the errors of points and world vectors, and, with gravity, of the rotation.
  std::vector<Reexpressed> retract(const Eigen::Ref<const Eigen::VectorXd>& error, Eigen::Index rows,
                                   const PointChart& chart);

  /// Another world frame: all that is in it is at to_T_world of where it was.
  void moveWorld(const SE3& to_T_world);

 private:
  struct Slot {
    Chart chart = Chart::kVector;
    Eigen::Index row = 0, size = 0; ///< size 0: free
  };

  Eigen::Vector3d commonTurn(const Eigen::Ref<const Eigen::VectorXd>& error, Eigen::Index rows,
                             const Eigen::Vector3d& seen_turn) const;
  bool goWithBody(const Eigen::Ref<const Eigen::VectorXd>& error, Eigen::Index rows,
                  const Eigen::Vector3d& seen_turn) const;

  SE3 pose_;
  Eigen::VectorXd mean_; ///< row by row like the errors, with room for more; the pose's rows are not used
  std::vector<Slot> slots_;
  std::vector<Handle> free_, order_;
  std::vector<Named> named_;
  Eigen::Index rows_ = 0;
};

/// M without the rows of a variable that is gone: `rows` were in use.
template <class Matrix>
void eraseRows(Matrix&& M, const Variables::Gone& gone, Eigen::Index rows) {
  const Eigen::Index behind = rows - gone.row - gone.size;
  if (gone.shifts)
    M.middleRows(gone.row, behind) = M.middleRows(gone.row + gone.size, behind).eval();
  else if (gone.from != gone.row)
    M.middleRows(gone.row, gone.size) = M.middleRows(gone.from, gone.size).eval();
}

} // namespace vi_ekf_slam
