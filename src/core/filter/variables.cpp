#include "vi_ekf_slam/core/filter/variables.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <stdexcept>
#include <string>

#include "vi_ekf_slam/core/geometry/so3.hpp"

namespace vi_ekf_slam {
namespace {

constexpr std::size_t kTurnPoints = 8; // of fewer the noise passes for a turn
constexpr double kLeastTurn = 1e-2;    // rad: half its square is a fiftieth of a pixel

/// What is left of theta once theta^ has been corrected, theta' = M (theta - theta^), to first order in it
/// (Mueller, Hehn and D'Andrea, JGCD 2017): a tilt that is learnt axis by axis turns the heading, too. The
/// error about the vertical is left as it is, since no measurement sees it: it must not pass for a tilt.
Eigen::Matrix3d leftOfTurn(const Eigen::Vector3d& theta) {
  Eigen::Matrix3d M = so3::leftJacobian(theta);
  M.col(2) = Eigen::Vector3d::UnitZ();
  return M;
}

} // namespace

Variables::Variables(const SE3& pose) : pose_(pose) { add(Chart::kPose, Eigen::VectorXd::Zero(6)); }

Handle Variables::reserve(Chart chart) {
  Handle handle = static_cast<Handle>(slots_.size());
  if (free_.empty()) {
    slots_.emplace_back();
  } else {
    handle = free_.back();
    free_.pop_back();
  }
  slots_[handle] = {chart, 0, 0};
  return handle;
}

Handle Variables::add(Chart chart, const Eigen::VectorXd& mean, const std::string& name) {
  const Eigen::Index size = mean.size();
  const bool is_any = chart == Chart::kVector || (chart == Chart::kBodyVector && size % 3 == 0);
  const bool fits = is_any ? size > 0 : size == (chart == Chart::kPose ? 6 : 3);
  if (!fits || (chart == Chart::kPose) != order_.empty())
    throw std::logic_error("a variable of " + std::to_string(size) + " rows does not fit its chart");
  if (find(name)) throw std::logic_error("there is a variable '" + name + "' already");
  const Handle handle = reserve(chart);
  restore(handle, mean);
  if (!name.empty()) named_.push_back({name, handle});
  return handle;
}

std::optional<Handle> Variables::find(const std::string& name) const {
  for (const Named& named : named_) {
    if (named.name == name) return named.handle;
  }
  return std::nullopt;
}

bool Variables::isLevel() const {
  return std::any_of(order_.begin(), order_.end(),
                     [this](Handle h) { return slots_[h].chart == Chart::kWorldVector; });
}

void Variables::restore(Handle handle, const Eigen::VectorXd& mean) {
  const Eigen::Index size = mean.size();
  if (rows_ + size > mean_.size()) mean_.conservativeResize(2 * (rows_ + size));
  mean_.segment(rows_, size) = mean;
  slots_[handle].row = rows_;
  slots_[handle].size = size;
  order_.push_back(handle);
  rows_ += size;
}

Variables::Gone Variables::remove(Handle handle, Fate fate) {
  Slot& slot = slots_.at(handle);
  if (slot.size == 0 || slot.chart == Chart::kPose)
    throw std::logic_error("there is no such variable to remove");
  const Slot& last = slots_[order_.back()];
  const auto place = std::find(order_.begin(), order_.end(), handle);
  const Gone gone{slot.row, slot.size, rows_ - slot.size, last.size != slot.size};
  Eigen::Map<Eigen::VectorXd> means(mean_.data(), mean_.size());
  eraseRows(means, gone, rows_);
  if (gone.shifts) {
    for (auto later = place; later != order_.end(); ++later) slots_[*later].row -= slot.size;
    order_.erase(place);
  } else {
    slots_[order_.back()].row = gone.row;
    *place = order_.back();
    order_.pop_back();
  }
  slot.size = 0;
  if (fate == Fate::kForgotten) {
    release(handle);
    named_.erase(std::remove_if(named_.begin(), named_.end(),
                                [handle](const Named& named) { return named.handle == handle; }),
                 named_.end());
  }
  rows_ -= gone.size;
  return gone;
}

/// Whether a correction moves the points in view with the body (the tilt of the way so far where a body was
/// blind, its length where the baseline is another) rather than the body alone (in a known map): by which of
/// the two the points are seen to move less, as angles. The chart of one camera has to take the rest to first
/// order. Without gravity no frame tells the way so far anything.
bool Variables::goWithBody(const Eigen::Ref<const Eigen::VectorXd>& error, Eigen::Index rows,
                           const Eigen::Vector3d& seen_turn) const {
  double in_body = 0.0, in_world = 0.0;
  for (const Handle handle : order_) {
    const Slot& slot = slots_[handle];
    if (slot.row >= rows) break;
    if (slot.chart != Chart::kPoint) continue;
    const Eigen::Vector3d way = mean_.segment<3>(slot.row) - pose_.translation();
    const Eigen::Vector3d y = error.segment<3>(slot.row) + seen_turn.cross(way);
    const Eigen::Vector3d d = y + error.segment<3>(3).cross(way) + error.head<3>();
    const double distance2 = way.squaredNorm();
    in_body += way.cross(y).squaredNorm() / (distance2 * distance2);
    in_world += way.cross(d).squaredNorm() / (distance2 * distance2);
  }
  return isLevel() && in_body < in_world;
}

/// By which a correction turns the points in view as one about the body, the least squares of their angles:
/// of the world, where only its tilt was not known. A chart of one camera takes the rest alone, since the
/// circles that a turn moves them on are straight in none.
Eigen::Vector3d Variables::commonTurn(const Eigen::Ref<const Eigen::VectorXd>& error, Eigen::Index rows,
                                      const Eigen::Vector3d& seen_turn) const {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  std::size_t points = 0;
  for (const Handle handle : order_) {
    const Slot& slot = slots_[handle];
    if (slot.row >= rows) break;
    if (slot.chart != Chart::kPoint) continue;
    const Eigen::Vector3d way = mean_.segment<3>(slot.row) - pose_.translation();
    const Eigen::Vector3d d =
        error.segment<3>(slot.row) + (error.segment<3>(3) + seen_turn).cross(way) + error.head<3>();
    A += Eigen::Matrix3d::Identity() - way * way.transpose() / way.squaredNorm();
    b += way.cross(d) / way.squaredNorm();
    ++points;
  }
  if (points < kTurnPoints) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d phi = A.ldlt().solve(b);
  return phi.norm() > kLeastTurn && phi.allFinite() ? phi : Eigen::Vector3d::Zero();
}

/// With x - p = Exp(theta) (x^ - p^ + y) the error left of y is Exp(theta^) (y - y^), along the axes in which
/// the corrected body sees the point.
std::vector<Variables::Reexpressed> Variables::retract(const Eigen::Ref<const Eigen::VectorXd>& error,
                                                       Eigen::Index rows, const PointChart& chart) {
  std::vector<Reexpressed> reexpressed;
  const Eigen::Matrix3d turn = so3::Exp(error.segment<3>(3));
  const bool with_body = chart && goWithBody(error, rows, chart.seen_turn);
  const Eigen::Vector3d common =
      chart && !with_body ? commonTurn(error, rows, chart.seen_turn) : Eigen::Vector3d::Zero();
  const bool turns = !common.isZero(0.0);
  const Eigen::Matrix3d U = so3::Exp(common);
  const Eigen::Vector3d before = pose_.translation(), now = before + error.head<3>();
  const Eigen::Matrix3d body_turn = pose_.rotation().transpose() * turn.transpose() * pose_.rotation();
  pose_ = SE3(turn * pose_.rotation(), now).normalized();
  for (const Handle handle : order_) {
    const Slot& slot = slots_[handle];
    if (slot.row >= rows) break;
    auto x = mean_.segment(slot.row, slot.size);
    const auto e = error.segment(slot.row, slot.size);
    if (slot.chart == Chart::kVector) x += e;
    for (Eigen::Index k = 0; slot.chart == Chart::kBodyVector && k < slot.size; k += 3) {
      x.segment<3>(k) += body_turn * e.segment<3>(k);
      reexpressed.push_back({slot.row + k, body_turn});
    }
    if (slot.chart == Chart::kWorldVector) {
      x = turn * (x + e).eval();
      reexpressed.push_back({slot.row, turn});
    }
    if (slot.chart != Chart::kPoint) continue;
    const Eigen::Vector3d way = x - before;
    const Eigen::Vector3d shift = error.head<3>();
    const LinearFunction by = chart.seen ? chart.seen(way) : LinearFunction();
    Eigen::Vector3d seen = e;
    if (!by.isNone()) seen += by.J * error.segment(by.row, by.J.cols());
    const Eigen::Matrix3d& V = with_body ? turn : U; // by which the point moves beforehand, exactly
    Eigen::Vector3d turned = way - shift, d = seen + (error.segment<3>(3) - common).cross(way) + shift;
    if (with_body) {
      turned = turn * way;
      d = turn * seen;
    } else if (turns) {
      turned = U * way - shift;
      d = (U * d).eval();
    }
    std::optional<MovedPoint> moved = chart ? chart.move(turn, turned, d) : std::nullopt;
    if (moved && (turns || with_body)) moved->M = (moved->M * V).eval();
    if (moved && !by.isNone()) moved->N.J += moved->M * by.J;
    x = now + (moved ? moved->way : Eigen::Vector3d(turn * (way + e)));
    if (moved)
      reexpressed.push_back({slot.row, moved->M, std::move(moved->N)});
    else
      reexpressed.push_back({slot.row, turn});
  }
  if (isLevel()) reexpressed.push_back({3, leftOfTurn(error.segment<3>(3))});
  return reexpressed;
}

void Variables::moveWorld(const SE3& to_T_world) {
  pose_ = (to_T_world * pose_).normalized();
  for (const Handle handle : order_) {
    const Slot& slot = slots_[handle];
    auto x = mean_.segment(slot.row, slot.size);
    if (slot.chart == Chart::kPoint) x = to_T_world * Eigen::Vector3d(x);
    if (slot.chart == Chart::kWorldVector) x = (to_T_world.rotation() * x).eval();
  }
}

} // namespace vi_ekf_slam
