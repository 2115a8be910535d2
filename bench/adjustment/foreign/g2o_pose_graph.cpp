// SPDX-License-Identifier: Apache-2.0
// Adjusts a 2D pose graph with g2o; pose_graph_driver.h describes the commands.
//
// Written for the g2o of the package g2o-python 0.0.12, whose graphs share ownership.
// Methods: gauss_newton and levenberg on all vertices at once; gauss_newton_schur, which lets g2o
// eliminate the nodes first.

#include <g2o/core/block_solver.h>
#include <g2o/core/optimization_algorithm_gauss_newton.h>
#include <g2o/core/optimization_algorithm_levenberg.h>
#include <g2o/core/robust_kernel_impl.h>
#include <g2o/core/sparse_optimizer.h>
#include <g2o/core/sparse_optimizer_terminate_action.h>
#include <g2o/solvers/eigen/linear_solver_eigen.h>
#include <g2o/types/slam2d/edge_se2.h>
#include <g2o/types/slam2d/vertex_se2.h>

#include <map>
#include <memory>

#include "pose_graph_driver.h"

namespace {

using Block = g2o::BlockSolver<g2o::BlockSolverTraits<3, 3>>;

std::shared_ptr<g2o::OptimizationAlgorithm> MakeAlgorithm(const std::string& method) {
  auto linear = std::make_unique<g2o::LinearSolverEigen<Block::PoseMatrixType>>();
  linear->setBlockOrdering(true);
  auto block = std::make_unique<Block>(std::move(linear));
  if (method == "levenberg") {
    return std::make_shared<g2o::OptimizationAlgorithmLevenberg>(std::move(block));
  }
  if (method == "gauss_newton" || method == "gauss_newton_schur") {
    return std::make_shared<g2o::OptimizationAlgorithmGaussNewton>(std::move(block));
  }
  return nullptr;
}

// One optimizer a method: how it is built depends on it.
class Optimizer {
 public:
  Optimizer(const Graph& graph, const std::string& method,
            const std::shared_ptr<g2o::OptimizationAlgorithm>& algorithm)
      : graph_(graph) {
    optimizer_.setAlgorithm(algorithm);
    for (int64_t v = 0; v < graph.num_vertices; ++v) {
      auto vertex = std::make_shared<g2o::VertexSE2>();
      vertex->setId(static_cast<int>(v));
      optimizer_.addVertex(vertex);
    }
    for (const int64_t v : graph.held) Vertex(v)->setFixed(true);
    if (method == "gauss_newton_schur") {
      for (const int64_t v : graph.eliminated) Vertex(v)->setMarginalized(true);
    }
    for (int64_t e = 0; e < graph.num_edges; ++e) AddEdge(e);
    Reset();
    optimizer_.initializeOptimization();
    CountIterations();
  }

  Answer Solve() {
    Reset();
    int done = 0;
    const double seconds = SecondsOf([&] { done = optimizer_.optimize(iterations_); });
    return {seconds, done, done > 0};
  }

  std::vector<double> Poses() {
    std::vector<double> poses;
    for (int64_t v = 0; v < graph_.num_vertices; ++v) {
      const g2o::Vector3 pose = Vertex(v)->estimate().toVector();
      poses.insert(poses.end(), pose.data(), pose.data() + 3);
    }
    return poses;
  }

 private:
  std::shared_ptr<g2o::VertexSE2> Vertex(int64_t v) {
    return std::static_pointer_cast<g2o::VertexSE2>(optimizer_.vertex(static_cast<int>(v)));
  }

  void AddEdge(int64_t e) {
    using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const double* measured = &graph_.measured[3 * e];
    const Eigen::Map<const RowMajor> whitening(&graph_.whitening[9 * e]);
    // g2o measures the error in the frame of b as measured
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(measured[2]).toRotationMatrix();
    const Eigen::Matrix3d whitening_b = whitening * turn;
    auto edge = std::make_shared<g2o::EdgeSE2>();
    edge->setVertex(0, Vertex(graph_.a[e]));
    edge->setVertex(1, Vertex(graph_.b[e]));
    edge->setMeasurement(g2o::SE2(measured[0], measured[1], measured[2]));
    edge->setInformation(whitening_b.transpose() * whitening_b);
    if (graph_.is_robust[e]) {
      auto huber = std::make_shared<g2o::RobustKernelHuber>();
      huber->setDelta(graph_.huber_scale);
      edge->setRobustKernel(huber);
    }
    optimizer_.addEdge(edge);
  }

  void Reset() {
    for (int64_t v = 0; v < graph_.num_vertices; ++v) {
      const double* pose = &graph_.start[3 * v];
      Vertex(v)->setEstimate(g2o::SE2(pose[0], pose[1], pose[2]));
    }
  }

  // The stopping rule of g2o evaluates all errors once more per iteration. Therefore the iterations
  // are counted in a first run, and timed in a second without the rule.
  void CountIterations() {
    auto terminate = std::make_shared<g2o::SparseOptimizerTerminateAction>();
    terminate->setGainThreshold(graph_.tolerance);
    optimizer_.addPostIterationAction(terminate);
    iterations_ = optimizer_.optimize(static_cast<int>(graph_.max_iterations));
    optimizer_.removePostIterationAction(terminate);
    optimizer_.setForceStopFlag(nullptr);
  }

  const Graph& graph_;
  g2o::SparseOptimizer optimizer_;
  int iterations_ = 0;
};

class G2oSolver : public PoseGraphSolver {
 public:
  explicit G2oSolver(const Graph& graph) : graph_(graph) {}

  bool Solve(const std::string& method, Answer* answer) override {
    std::unique_ptr<Optimizer>& optimizer = optimizers_[method];
    if (optimizer == nullptr) {
      const auto algorithm = MakeAlgorithm(method);
      if (algorithm == nullptr) return false;
      optimizer = std::make_unique<Optimizer>(graph_, method, algorithm);
    }
    *answer = optimizer->Solve();
    last_ = optimizer.get();
    return true;
  }

  std::vector<double> Poses() const override {
    return last_ == nullptr ? graph_.start : last_->Poses();
  }

 private:
  const Graph& graph_;
  std::map<std::string, std::unique_ptr<Optimizer>> optimizers_;
  Optimizer* last_ = nullptr;
};

}  // namespace

int main(int argc, char** argv) {
  Graph graph;
  if (argc != 2 || !ReadGraph(argv[1], &graph)) {
    std::cerr << "g2o_pose_graph: give the file of a graph, as compiled_drivers.py writes it\n";
    return 1;
  }
  G2oSolver solver(graph);
  return Serve(&solver);
}
