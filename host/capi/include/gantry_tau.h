/*
 * gantry_tau.h: the C interface of gantry-tau, the controller core of Gantry-Tau parallel robots.
 * Written by cbindgen from host/capi/src. Do not edit. How to begin: host/capi/README.md. The protocol on the wire: wire.md.
 *
 * MEMORY. Nothing is allocated and nothing is to be freed. Objects (gt_server, gt_l2, gt_f1, gt_..._compensator, gt_sensor) live in
 * memory of the caller, of GT_..._SIZE bytes (bounds that hold on every target), aligned to GT_ALIGN:
 *
 *     static GT_MEMORY(GT_SERVER_SIZE_3) memory;
 *     gt_server *server;
 *     gt_code code = gt_server_init(&memory, sizeof memory, &config, &start, &server, &error);
 *
 * An object must not be moved, copied or written to. Everything else is copied: no pointer is kept beyond its call.
 *
 * POINTERS. A pointer must point to what its type says, for as long as the call lasts. Null is refused with GT_CODE_NULL_POINTER where
 * it is not said to be allowed, a misaligned one with GT_CODE_MISALIGNED, and a handle to memory that holds no such object with
 * GT_CODE_NO_OBJECT. `error` may be null everywhere; it receives the details of the code that is returned, GT_CODE_OK included.
 * Where a call returns an error, its other results are not written, and nothing is changed, unless it says otherwise.
 *
 * THREADS. There is no global state. Calls on different objects are independent. Calls on one gt_server or gt_sensor must not overlap;
 * machines and compensators are never changed by a call and may be shared.
 *
 * TIME. No call blocks, locks, allocates, or calls back into C; every loop is bounded by a constant or by a length that is given.
 *
 * FLOATING POINT. Any number may be passed, NaN and infinities included: what is not accepted is an error, never undefined. What comes
 * out is finite. All functions may be called from interrupts that save the floating-point registers.
 *
 * UNITS. References in nm, um/s and per mille of rated torque, all integers. Kinematics in SI units; q in q-units: metres for a cart
 * whose guideway has unit length, radians for plates. Axes, arms, links and motors count from 0.
 */


#ifndef GANTRY_TAU_H
#define GANTRY_TAU_H

#include <stddef.h>
#include <stdint.h>

/* Memory for an object, for static or automatic storage; aligned to GT_ALIGN where that matters. */
#define GT_MEMORY(size) union { long double alignment; unsigned char bytes[size]; }


// Version of this interface. It changes with every change to a type, a constant or the meaning of a function.
#define GT_ABI_VERSION 1

// Longest line of a black box, bytes.
#define GT_BLACK_BOX_LINE 16384

// Bytes of a gt_l2_compensator.
#define GT_L2_COMPENSATOR_SIZE 4096

// Bytes of a gt_f1_compensator.
#define GT_F1_COMPENSATOR_SIZE 2560

// Bytes of a gt_f1.
#define GT_F1_SIZE 2048

// Bytes of a gt_l2.
#define GT_L2_SIZE 2048

// Number of links, in the order 11, 21, 22, 31, 32, 33: the first digit is the arm, and how many links it has.
#define GT_LINKS 6

// Number of arms, carts and guideways.
#define GT_ARMS 3

// Linear solves that a seed from the cycle before needs at most, at 1 m/s and 1 kHz.
#define GT_WARM_SOLVES 2

// Linear solves for any other seed.
#define GT_COLD_SOLVES 10

// Alignment that is enough for every object on every target; what malloc gives, and GT_MEMORY.
#define GT_ALIGN 16

// Bytes of a gt_sensor.
#define GT_SENSOR_SIZE 512

// Length of arrays per axis.
#define GT_MAX_AXES 6

// Length of arrays per motor.
#define GT_MAX_MOTORS 12

// Connections that can be open at once: the owner, and strangers who are told why they cannot be.
#define GT_MAX_CONNECTIONS 6

// TCP and the like: bytes come in pieces of any length. A broken frame ends the connection, and its session.
#define GT_TRANSPORT_STREAM 0

// UDP and the like: each gt_server_feed is one whole datagram. A broken one is dropped.
#define GT_TRANSPORT_DATAGRAM 1

// No black box.
#define GT_BLACK_BOX_NONE 0

// A black box: at least so many ticks before the end of a session, and so many after it.
#define GT_BLACK_BOX_TICKS 64

// Bytes of a server with 3 axes and no black box, on any target.
#define GT_SERVER_SIZE_3 8448

// Bytes of a server with 6 axes and no black box.
#define GT_SERVER_SIZE_6 11008

// Bytes of a server with 3 axes and a black box.
#define GT_SERVER_SIZE_3_BLACK_BOX 368640

// Bytes of a server with 6 axes and a black box; enough for every server.
#define GT_SERVER_SIZE_6_BLACK_BOX 548864

// Longest frame, bytes.
#define GT_MAX_FRAME 394

// The reference was clamped to the machine's travel.
#define GT_FLAG_TRAVEL 1

// The position offset could not reach its target within step and accel.
#define GT_FLAG_POSITION_LIMITED 2

// The same for the velocity offset.
#define GT_FLAG_VELOCITY_LIMITED 4

// The same for the torque offset.
#define GT_FLAG_TORQUE_LIMITED 8

// The nominal reference stepped further than nominal_step_nm.
#define GT_FLAG_NOMINAL_STEP 16

// What a call led to. 0 is success; every error of the library has a code of its own, and its details are in gt_error.
// Axes, arms, links and motors count from 0.
enum gt_code
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Done.
  GT_CODE_OK = 0,
  // A pointer is null that must not be.
  GT_CODE_NULL_POINTER = 1,
  // A pointer is not aligned for what it points to.
  GT_CODE_MISALIGNED = 2,
  // The memory is smaller than the object. `value`: bytes needed.
  GT_CODE_MEMORY_TOO_SMALL = 3,
  // This is no such object: not initialised, initialised as another, or overwritten.
  GT_CODE_NO_OBJECT = 4,
  // A length is larger than any object can be.
  GT_CODE_LENGTH = 5,
  // A buffer is too small. `value`: bytes needed.
  GT_CODE_BUFFER_TOO_SMALL = 6,
  // There is no entry of this index.
  GT_CODE_INDEX = 7,
  // Neither GT_TRANSPORT_STREAM nor GT_TRANSPORT_DATAGRAM.
  GT_CODE_TRANSPORT = 8,
  // The number of motors is not 1 to GT_MAX_MOTORS. `value`: the refused number.
  GT_CODE_MOTOR_COUNT = 9,
  // Neither GT_BLACK_BOX_NONE nor GT_BLACK_BOX_TICKS. `value`: the refused number.
  GT_CODE_BLACK_BOX = 10,
  // A branch or a sign is neither 1 nor -1. `index`: which one.
  GT_CODE_BRANCH = 11,
  // M of a channel is negative. `index`: axis, `parameter`: channel, `value`: M.
  GT_CODE_LIMITS_NEGATIVE_MAX = 100,
  // rho of a channel is zero or negative. `index`: axis, `parameter`: channel, `value`: rho.
  GT_CODE_LIMITS_RAMP_NOT_POSITIVE = 101,
  // rho of a channel is above S. `index`: axis, `parameter`: channel, `value`: rho, `upper`: S.
  GT_CODE_LIMITS_RAMP_ABOVE_STEP = 102,
  // A of a channel is below S + rho. `index`: axis, `parameter`: channel, `value`: A, `lower`: S + rho.
  GT_CODE_LIMITS_ACCEL_TOO_SMALL = 103,
  // The number of axes is neither 3 nor 6. `value`: the refused number.
  GT_CODE_CONFIG_AXES = 200,
  // The handshake would never or at once time out: handshake_ticks is 0.
  GT_CODE_CONFIG_HANDSHAKE_TICKS = 201,
  // The window of the miss budget is above 128 ticks. `value`: the window.
  GT_CODE_CONFIG_BUDGET_WINDOW = 202,
  // M of a torque channel does not fit 16 bits. `index`: axis.
  GT_CODE_CONFIG_TORQUE_MAX = 203,
  // A travel has its ends reversed, or beyond 2^61 nm. `index`: axis.
  GT_CODE_CONFIG_TRAVEL = 204,
  // The nominal travel lies less than M of the position channel inside the machine's travel. `index`: axis.
  GT_CODE_CONFIG_MARGIN = 205,
  // An offset in force is beyond its limits, and the server must not start.
  // `index`: axis, `value`: its position offset in nm, `lower`: velocity in um/s, `upper`: torque in per mille.
  GT_CODE_START_OFFSET_IN_FORCE = 300,
  // A motor is mapped to an axis that does not exist. `index`: motor, `value`: the axis, `upper`: how many there are.
  GT_CODE_MOTOR_MAP = 400,
  // GT_MAX_CONNECTIONS are open already. gt_server_refusal has what the peer should be told.
  GT_CODE_FULL = 500,
  // A number of a machine is NaN or infinite. `parameter` and `index`: which.
  GT_CODE_ROBOT_NOT_FINITE = 600,
  // A number of a machine has a magnitude outside `lower` to `upper`. `parameter` and `index`: which.
  GT_CODE_ROBOT_OUT_OF_RANGE = 601,
  // The lower end of a travel is above its upper end. `parameter` and `index`: which.
  GT_CODE_ROBOT_REVERSED = 602,
  // The matrix of an orientation is no rotation. `value`: largest deviation of R^T R from the identity.
  GT_CODE_NOMINAL_NOT_ROTATION = 700,
  // The Tau property is violated. `index`: the link that differs from the first of its cluster, `value`: by how much, m.
  GT_CODE_NOMINAL_NOT_TAU = 701,
  // The gain is not from 0 to 1.
  GT_CODE_COMPENSATOR_GAIN = 800,
  // A limit is negative. `index`: axis.
  GT_CODE_COMPENSATOR_LIMIT = 801,
  // metres_per_q is not finite or out of range. `index`: axis.
  GT_CODE_COMPENSATOR_METRES_PER_Q = 802,
  // A number given, or one computed from it, is NaN or infinite.
  GT_CODE_KINEMATICS_NOT_FINITE = 900,
  // The links of an arm are too short to reach the pose. `index`: arm.
  GT_CODE_KINEMATICS_UNREACHABLE = 901,
  // The carts stand so that their links cannot meet.
  GT_CODE_KINEMATICS_NO_ASSEMBLY = 902,
  // The pose exists only beyond a singularity. `index`: the arm that would be on its other side, -1: the tool would.
  GT_CODE_KINEMATICS_OTHER_BRANCH = 903,
  // The pose is singular, or too close to it. `value`: the measure, 0 at the singularity.
  GT_CODE_KINEMATICS_SINGULAR = 904,
  // An axis would leave its travel. `index`: axis, `value`: where it would be, `lower`, `upper`: its travel; q-units.
  GT_CODE_KINEMATICS_OUT_OF_RANGE = 905,
  // The iteration did not come to an end. `iterations`: made, `value`: largest error of a link's length then, m.
  GT_CODE_KINEMATICS_NOT_CONVERGED = 906,
  // Without a seed this machine's forward kinematics has no start.
  GT_CODE_KINEMATICS_SEED_REQUIRED = 907,
  // A pose and positions that were given together do not fit the length of an arm's links. `index`: arm.
  GT_CODE_KINEMATICS_INCONSISTENT = 908,
  // The rotation of a sensor's mounting is none.
  GT_CODE_SENSOR_NOT_ROTATION = 1000,
  // A number of a sensor is not from `lower` to `upper`. `parameter`: which.
  GT_CODE_SENSOR_OUT_OF_RANGE = 1001,
  // A component of a reading is NaN, infinite or beyond 1e6; the reading was not used.
  GT_CODE_SENSOR_BAD_READING = 1002,
  // A sensor's state contradicts itself. No function of this interface returns it: a sensor's state is never given from outside.
  GT_CODE_SENSOR_INVALID_STATE = 1003,
  // A length to be converted is NaN or infinite.
  GT_CODE_CROSSING_NOT_FINITE = 1100,
  // A length to be converted is out of range. `upper`: largest magnitude, nm.
  GT_CODE_CROSSING_OUT_OF_RANGE = 1101,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_code gt_code;
#else
typedef int32_t gt_code;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Which parameter an error is about.
enum gt_parameter
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // None, or the code says it.
  GT_PARAMETER_NONE = 0,
  // cart_joints_m; the index is the link.
  GT_PARAMETER_CART_JOINT = 1,
  // guideways; the index is the arm.
  GT_PARAMETER_GUIDEWAY = 2,
  // platform_joints_m; the index is the link.
  GT_PARAMETER_PLATFORM_JOINT = 3,
  // lengths_m; the index is the arm (L2) or the link (F1).
  GT_PARAMETER_LENGTH = 4,
  // travel; the index is the axis.
  GT_PARAMETER_TRAVEL = 5,
  // link_m_per_n; the index is the link.
  GT_PARAMETER_LINK_COMPLIANCE = 6,
  // axis_per_n; the index is the axis.
  GT_PARAMETER_CART_COMPLIANCE = 7,
  // carts_m; the index is the arm.
  GT_PARAMETER_CART = 8,
  // plate_joints_m; the index is the link.
  GT_PARAMETER_PLATE_JOINT = 9,
  // turn_axis.
  GT_PARAMETER_TURN_AXIS = 10,
  // tilt_axis.
  GT_PARAMETER_TILT_AXIS = 11,
  // lever_m of a sensor.
  GT_PARAMETER_LEVER = 12,
  // cutoff_hz of a sensor.
  GT_PARAMETER_CUTOFF = 13,
  // cycle_s of a sensor.
  GT_PARAMETER_CYCLE = 14,
  // tare_samples of a sensor.
  GT_PARAMETER_TARE_SAMPLES = 15,
  // The position channel; the index is the axis.
  GT_PARAMETER_POSITION = 16,
  // The velocity channel; the index is the axis.
  GT_PARAMETER_VELOCITY = 17,
  // The torque channel; the index is the axis.
  GT_PARAMETER_TORQUE = 18,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_parameter gt_parameter;
#else
typedef int32_t gt_parameter;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Why a session ended, or why the server is not listening; numbers as on the wire.
enum gt_cause
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Nothing has ended.
  GT_CAUSE_NONE = 0,
  // Two deadlines in a row passed without any Command.
  GT_CAUSE_CLIENT_LATE = 1,
  // Two deadlines in a row passed, but Commands for older ticks did arrive.
  GT_CAUSE_NETWORK_LATE = 2,
  // The server overran its own cycle.
  GT_CAUSE_SERVER_LATE = 3,
  // A broken frame boundary or checksum on the owner's stream.
  GT_CAUSE_MALFORMED = 4,
  // The owner's connection was closed, or could not take a State.
  GT_CAUSE_CLOSED = 5,
  // The owner said goodbye.
  GT_CAUSE_GOODBYE = 6,
  // More misses within the window than the budget allows.
  GT_CAUSE_BUDGET = 7,
  // A stop, at the machine or by the owner.
  GT_CAUSE_STOP = 8,
  // The nominal reference stepped further than its limit.
  GT_CAUSE_NOMINAL = 9,
  // The owner sent more frames in one tick than are read.
  GT_CAUSE_FLOOD = 10,
  // No Command followed the Welcome in time.
  GT_CAUSE_HANDSHAKE_TIMEOUT = 11,
  // The server started, or resumed, with offsets still in force.
  GT_CAUSE_RESTART = 12,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_cause gt_cause;
#else
typedef int32_t gt_cause;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Phases of a session; numbers as on the wire.
enum gt_phase
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // No session. All offsets are zero.
  GT_PHASE_LISTENING = 0,
  // A session is granted, its first Command is awaited. All offsets are zero.
  GT_PHASE_HANDSHAKE = 1,
  // Commands move a shadow that is only reported. All offsets are zero.
  GT_PHASE_SUBMIT = 2,
  // Commands move the references.
  GT_PHASE_OBTAIN = 3,
  // The session is over, every offset ramps to zero.
  GT_PHASE_SAFE_DISCONNECT = 4,
  // Stopped: every offset ramps to zero, and only a local re-arm leads out.
  GT_PHASE_FAULT = 5,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum gt_phase gt_phase;
#else
typedef int32_t gt_phase;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A machine with six axes; its memory is the caller's, and no call changes it: threads may share it.
typedef struct gt_f1 gt_f1;

// A compensator of a machine with six axes; no call changes it: threads may share it.
typedef struct gt_f1_compensator gt_f1_compensator;

// A machine with three axes; its memory is the caller's, and no call changes it: threads may share it.
typedef struct gt_l2 gt_l2;

// A compensator of a machine with three axes; no call changes it: threads may share it.
typedef struct gt_l2_compensator gt_l2_compensator;

// A force sensor.
typedef struct gt_sensor gt_sensor;

// A server; its memory is the caller's.
typedef struct gt_server gt_server;

// How a machine yields, and how much of it is corrected. Of the arrays per axis only the machine's axes are looked at.
typedef struct gt_compensator_config {
  // Elongation of each link per newton of tension, m/N, link order; positive.
  double link_m_per_n[GT_LINKS];
  // How far each axis yields per unit of load, q-units (carts: m/N, plates: rad/(N m)); positive.
  double axis_per_n[GT_MAX_AXES];
  // Length of one unit of each q, m: |v_i| for a cart, the screw's law for a plate.
  double metres_per_q[GT_MAX_AXES];
  // Largest magnitude of each axis' offset, nm; 0 means 0.
  int32_t limits_nm[GT_MAX_AXES];
  // Share of the computed displacement that is corrected, 0 to 1. Against a workpiece of stiffness K a measured load fed back is stable
  // only while the estimated compliance stays below the machine's plus 1/K.
  double gain;
} gt_compensator_config;

// What went wrong, with all that is known of it. What a field means depends on the code; a field that the code does not use is 0.
typedef struct gt_error {
  // The code that the call returned, GT_CODE_OK included.
  gt_code code;
  // Which axis, arm, link or motor, counted from 0; -1 for none.
  int32_t index;
  // Which parameter.
  gt_parameter parameter;
  // Linear solves made.
  int32_t iterations;
  // The value that was refused, or a measure of how wrong it is.
  double value;
  // Smallest value that is accepted.
  double lower;
  // Largest value that is accepted.
  double upper;
} gt_error;

// A load on the platform, applied BY THE ENVIRONMENT TO THE PLATFORM; moment about the tool centre point.
typedef struct gt_wrench {
  // F, N; world axes.
  double force_n[3];
  // M, N m; world axes.
  double moment_nm[3];
} gt_wrench;

// What one cycle asks of the axes.
typedef struct gt_correction {
  // Offset of each axis, nm, within its limit; 0 for axes that are not there.
  int32_t offsets_nm[GT_MAX_AXES];
  // 1 where the limit cut it short.
  uint8_t saturated[GT_MAX_AXES];
} gt_correction;

// Where the tool is and how it is turned: x_world = T + R x_platform.
typedef struct gt_pose {
  // T: tool centre point, world axes, m.
  double position_m[3];
  // R: world axes from platform axes, row by row.
  double rotation[3][3];
} gt_pose;

// Geometry of a machine with six axes. Joints on the plates: A_ij = C_i + q_i V_i + Q_i P_ij, where plate 2 is turned by
// Rot(ax, sigma4 q4), plate 3 by Rot(ax, sigma5 q5) Rot(ax6, q6), plate 1 not at all. World axes, m.
typedef struct gt_f1_geometry {
  // C: origins of the carts' plates at q = 0.
  double carts_m[GT_ARMS][3];
  // V: directions of the guideways, m per unit of q.
  double guideways[GT_ARMS][3];
  // P: joints on the plates from the plate's origin, plate axes, link order.
  double plate_joints_m[GT_LINKS][3];
  // b: joints on the platform from the tool centre point, platform axes, link order.
  double platform_joints_m[GT_LINKS][3];
  // L: length of each link, link order.
  double lengths_m[GT_LINKS];
  // Side of each guideway the links point to: 1 or -1.
  int32_t inverse_branch[GT_ARMS];
  // ax: what plates 2 and 3 turn about, of any length.
  double turn_axis[3];
  // ax6: what plate 3 tilts about, axes of the turned plate, of any length.
  double tilt_axis[3];
  // sigma4, sigma5: which way plates 2 and 3 turn for positive q4, q5: 1 or -1.
  int32_t turn_signs[2];
  // 0: carts are not checked, and plates within half a turn.
  uint8_t has_travel;
  // Range of each q, lower and upper end, q-units; rad for the last three.
  double travel[6][2];
} gt_f1_geometry;

// How an iterative answer was come by.
typedef struct gt_solved {
  // Linear solves made.
  int32_t iterations;
  // Largest error of a link's length, m.
  double residual_m;
} gt_solved;

// Geometry of a machine with three axes: joints on the carts A_ij = A0_ij + q_i v_i, on the platform B_ij = T + R b_ij. World axes, m.
typedef struct gt_l2_geometry {
  // A0: joints on the carts at q = 0, link order.
  double cart_joints_m[GT_LINKS][3];
  // v: directions of the guideways, m per unit of q.
  double guideways[GT_ARMS][3];
  // b: joints on the platform from the tool centre point, platform axes, link order.
  double platform_joints_m[GT_LINKS][3];
  // L: link length of each arm.
  double lengths_m[GT_ARMS];
  // R: world axes from platform axes, row by row; constant.
  double rotation[3][3];
  // Side of each guideway the links point to, sign(s_i . v_i): 1 or -1.
  int32_t inverse_branch[GT_ARMS];
  // Side of the carts' plane the tool is on, sign(n . (T - P_1)), n = (P_2 - P_1) x (P_3 - P_1): 1 or -1.
  int32_t forward_branch;
  // 0: the range of q is not checked.
  uint8_t has_travel;
  // Range of each q, lower and upper end, q-units.
  double travel[GT_ARMS][2];
} gt_l2_geometry;

// How a sensor is mounted and filtered.
typedef struct gt_sensor_config {
  // R: world axes from sensor axes, row by row.
  double rotation[3][3];
  // p: from the tool centre point to the sensor's origin, world axes, m; at most 10.
  double lever_m[3];
  // Cut-off frequency of the low-pass, Hz, 1e-3 to 1e5.
  double cutoff_hz;
  // Time between two samples, s, 1e-6 to 10.
  double cycle_s;
  // Samples of the tare, 1 to 1e6; the tool must be unloaded meanwhile.
  uint32_t tare_samples;
} gt_sensor_config;

// Limits of one offset channel. It takes 0 < ramp <= step, step + ramp <= accel, and max >= 0.
// Units: nm, um/s or per mille of rated torque, by the channel; per tick.
typedef struct gt_limits {
  // M: largest magnitude; 0 disables the channel.
  int32_t max;
  // S: largest change per tick.
  int32_t step;
  // A: largest change of the change per tick.
  int32_t accel;
  // rho: change per tick on the way back to zero.
  int32_t ramp;
} gt_limits;

// How one axis may be moved.
typedef struct gt_axis_config {
  // Position offset, nm.
  struct gt_limits position;
  // Velocity offset, um/s.
  struct gt_limits velocity;
  // Torque offset, per mille of rated torque.
  struct gt_limits torque;
  // Where the nominal reference may be, lower end, nm.
  int64_t nominal_lower_nm;
  // Upper end.
  int64_t nominal_upper_nm;
  // Where the drive's reference may be, lower end, nm; at least position.max further out than the nominal one, at both ends.
  int64_t machine_lower_nm;
  // Upper end.
  int64_t machine_upper_nm;
  // Largest change of the nominal reference per tick, nm. 0: it must not move.
  uint32_t nominal_step_nm;
} gt_axis_config;

// Configuration of a server. gt_server_config_thesis fills one.
typedef struct gt_server_config {
  // Number of axes, 3 (L2) or 6 (F1). Of every array per axis only so many entries are looked at.
  uint32_t axes;
  // Number of motors, 1 to GT_MAX_MOTORS.
  uint32_t motors;
  // Which axis drives each motor, counted from 0. Two motors on one cart have the same axis, and always get equal references.
  uint8_t axis_of_motor[GT_MAX_MOTORS];
  // GT_BLACK_BOX_NONE, or GT_BLACK_BOX_TICKS: so many ticks before the end of a session and after it are kept.
  uint32_t black_box_ticks;
  // Length of a cycle, us; only told to the client, the library has no clock.
  uint32_t cycle_us;
  // Ticks that a granted session may wait for its first Command; at least 1.
  uint32_t handshake_ticks;
  // Checksum of the kinematic parameters, told to the client: gt_l2_checksum, gt_f1_checksum, or 0.
  uint32_t kinematics_checksum;
  // What the server does: 0, or 1 for lock-step. A client must have the same abilities.
  uint16_t capabilities;
  // How many ticks the echo of a Command may be behind the last State; 0 as a rule.
  uint8_t echo_window;
  // Window of the miss budget in ticks, 1 to 128; 0: no budget beside the rule of two in a row.
  uint8_t budget_window;
  // Misses tolerated within any such window; one more ends the session.
  uint8_t budget_allowed;
  // The axes.
  struct gt_axis_config axis[GT_MAX_AXES];
} gt_server_config;

// The external offsets of one axis.
typedef struct gt_offsets {
  // Added to the position reference (CiA 402 object 60B0h), nm.
  int32_t position_nm;
  // Added to the velocity reference (60B1h), um/s.
  int32_t velocity_um_s;
  // Added to the torque reference (60B2h), per mille of rated torque.
  int16_t torque_permille;
} gt_offsets;

// Where a server starts from.
typedef struct gt_start {
  // Offsets that the drives have in force, read back from them. Nonzero ones are ramped to zero before anybody gets a session.
  struct gt_offsets in_force[GT_MAX_AXES];
  // Nominal references of the cycle before the first, nm.
  int64_t nominal_nm[GT_MAX_AXES];
  // Number of that cycle.
  uint64_t tick;
  // The last epoch that was ever given, from storage that survives a restart; 0: none.
  uint64_t last_epoch;
} gt_start;

// A frame to be written to a connection.
typedef struct gt_frame {
  // To whom.
  uint64_t connection;
  // How many bytes.
  uint32_t length;
  // The bytes; those from `length` on are 0.
  uint8_t bytes[GT_MAX_FRAME];
} gt_frame;

// What a drive measures.
typedef struct gt_actual {
  // Position of the motor side of the axis, nm.
  int64_t position_nm;
  // Velocity, um/s.
  int32_t velocity_um_s;
  // Torque, per mille of rated torque.
  int16_t torque_permille;
} gt_actual;

// What one tick is given.
typedef struct gt_cycle {
  // Cycles since the last tick: 1 when on time; more after an overrun, and each skipped one is a miss. 0 counts as 1.
  uint32_t elapsed;
  // Not 0: the stop at the machine is asserted.
  uint8_t stop;
  // Not 0: somebody at the machine re-arms. It must be seen released in Fault before it counts.
  uint8_t rearm;
  // When in the cycle the last Command arrived, us after the last State left; evidence only, 0 where it is not timed.
  uint16_t arrival_us;
  // Epoch for the next session: above every epoch ever given, written to storage before this call.
  uint64_t next_epoch;
  // Nominal references of this cycle, nm.
  int64_t nominal_nm[GT_MAX_AXES];
  // What the drives measure.
  struct gt_actual actual[GT_MAX_AXES];
} gt_cycle;

// What one motor's drive receives.
typedef struct gt_reference {
  // Position reference: nominal plus offset, inside the machine's travel, nm.
  int64_t position_nm;
  // Additive velocity reference, um/s.
  int32_t velocity_offset_um_s;
  // Additive torque reference, per mille of rated torque.
  int16_t torque_offset_permille;
} gt_reference;

// Counts since the session was granted; they saturate.
typedef struct gt_counters {
  // Frames of the owner, whatever their content.
  uint32_t received;
  // Deadlines that passed without a fresh valid Command.
  uint32_t missed;
  // Commands for a tick already past, or overtaken in the same tick.
  uint32_t late;
  // Commands with the sequence of one that was accepted.
  uint32_t duplicate;
  // Frames of another epoch, out of sequence, or echoing a tick that was never sent.
  uint32_t stale;
  // Well-framed Commands with bad content, and frames that have no place in the phase.
  uint32_t malformed;
  // Commands refused because a target lies beyond M.
  uint32_t out_of_range;
  // Channel steps that step or accel held back.
  uint32_t limited;
  // References that the travel clamped.
  uint32_t clamped;
  // Frames from connections that own nothing, Hellos aside.
  uint32_t strangers;
  // Longest run of consecutive misses.
  uint16_t longest_miss_run;
} gt_counters;

// One axis after a tick.
typedef struct gt_axis_state {
  // Nominal reference, without offset, nm.
  int64_t nominal_nm;
  // Offsets in force.
  struct gt_offsets offsets;
  // Where the offsets would be if Submit were Obtain; zero outside Submit.
  struct gt_offsets shadow;
  // What the drive measures.
  struct gt_actual actual;
  // What was clamped or limited in this tick: GT_FLAG_ bits.
  uint8_t flags;
} gt_axis_state;

// The server after a tick: what the owner is told, for a monitor.
typedef struct gt_state {
  // Number of this tick.
  uint64_t tick;
  // Epoch of the current or last session.
  uint64_t epoch;
  // Sequence of the last accepted Command; 0 before the first.
  uint64_t accepted;
  // The phase.
  gt_phase phase;
  // Why the last session ended; it stays until the next end.
  gt_cause cause;
  // Ticks until every offset would be zero if the ramp began now.
  uint32_t ramp_ticks_left;
  // When in the cycle the last Command arrived, us, as given.
  uint16_t arrival_us;
  // On-time Commands among the last 100 deadlines.
  uint8_t on_time_of_100;
  // Counts since the session was granted.
  struct gt_counters counters;
  // How many axes there are.
  uint32_t axis_count;
  // The axes; those that are not there are zero.
  struct gt_axis_state axes[GT_MAX_AXES];
} gt_state;

// What one tick gives back.
typedef struct gt_turn {
  // How many motors there are.
  uint32_t motor_count;
  // What every motor receives, in every tick; those that are not there are zero.
  struct gt_reference motors[GT_MAX_MOTORS];
  // How many frames wait to be written: gt_server_frame.
  uint32_t frame_count;
  // How many connections are to be closed once their frames are written. The server has forgotten them already.
  uint32_t close_count;
  // Those connections.
  uint64_t close[GT_MAX_CONNECTIONS];
  // Hellos refused in this tick.
  uint32_t refused;
  // Not 0: a session was granted in this tick, and next_epoch is used up.
  uint8_t welcomed;
  // Not 0: `owner` has a session, or is still told how it ends.
  uint8_t has_owner;
  // The owner's connection.
  uint64_t owner;
  // Why a session ended, or the server stopped, in this tick; GT_CAUSE_NONE: neither.
  gt_cause ended;
  // The state after the tick.
  struct gt_state state;
} gt_turn;

// What a black box holds.
typedef struct gt_black_box {
  // Ticks recorded, at most 3 GT_BLACK_BOX_TICKS.
  uint32_t ticks;
  // Lines of its file; 0 while no tick is recorded.
  uint32_t lines;
  // Not 0: the end of a session has frozen it, GT_BLACK_BOX_TICKS ticks ago. It records again after gt_server_black_box_release.
  uint8_t frozen;
} gt_black_box;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// GT_ABI_VERSION of the library that is linked: compare it with the header's before anything else.
uint32_t gt_abi_version(void);

// Version of the library, such as "0.1.0". Static, never to be freed.
const char *gt_version(void);

// The name of a code in this header, such as "GT_CODE_NULL_POINTER"; "GT_CODE_UNKNOWN" for a number that is no code.
// Static, never to be freed.
const char *gt_code_name(int32_t code);

// Makes a compensator of a machine in `memory`. The machine is copied and may go.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_COMPENSATOR_SIZE bytes. `compensator`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
gt_code gt_l2_compensator_init(void *memory,
                               size_t size,
                               const struct gt_l2 *machine,
                               const struct gt_compensator_config *config,
                               struct gt_l2_compensator **compensator,
                               struct gt_error *error);

// One cycle: offsets that hold the tool where the nominal positions q (q-units) put it, under `load`; to first order, at constant cost.
// Whatever the load, what comes out is within the limits, or an error.
//
// Errors: KINEMATICS_: as gt_l2_forward and gt_l2_inverse.
//
gt_code gt_l2_correction(const struct gt_l2_compensator *compensator,
                         const double q[3],
                         const struct gt_wrench *load,
                         struct gt_correction *correction,
                         struct gt_error *error);

// As gt_l2_correction, by the exact map: large deflections, a platform that turns as the links let it. At most 10 rounds, each with
// two solves of six equations.
//
// Errors: KINEMATICS_: as gt_l2_forward; SINGULAR, NOT_CONVERGED, NOT_FINITE.
//
gt_code gt_l2_exact_correction(const struct gt_l2_compensator *compensator,
                               const double q[3],
                               const struct gt_wrench *load,
                               struct gt_correction *correction,
                               struct gt_error *error);

// Makes a compensator of a machine in `memory`. The machine is copied and may go.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_COMPENSATOR_SIZE bytes. `compensator`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, ROBOT_ (a compliance), COMPENSATOR_: the first found.
gt_code gt_f1_compensator_init(void *memory,
                               size_t size,
                               const struct gt_f1 *machine,
                               const struct gt_compensator_config *config,
                               struct gt_f1_compensator **compensator,
                               struct gt_error *error);

// One cycle: offsets that hold `pose`, which belongs to the nominal positions q (q-units), under `load`; to first order. The pose comes
// from gt_f1_forward, seeded by that of the cycle before. Whatever the load, what comes out is within the limits, or an error.
//
// Errors: KINEMATICS_: as gt_f1_inverse.
//
gt_code gt_f1_correction(const struct gt_f1_compensator *compensator,
                         const struct gt_pose *pose,
                         const double q[6],
                         const struct gt_wrench *load,
                         struct gt_correction *correction,
                         struct gt_error *error);

// As gt_f1_correction, by the exact map: at most 10 inverses.
//
// Errors: KINEMATICS_: as gt_f1_inverse.
//
gt_code gt_f1_exact_correction(const struct gt_f1_compensator *compensator,
                               const struct gt_pose *pose,
                               const double q[6],
                               const struct gt_wrench *load,
                               struct gt_correction *correction,
                               struct gt_error *error);

// Makes a machine in `memory`: checks every number, once.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_F1_SIZE bytes. `machine`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (indices 3 and 4: turn_signs), those of ROBOT_: the first found.
gt_code gt_f1_init(void *memory,
                   size_t size,
                   const struct gt_f1_geometry *geometry,
                   struct gt_f1 **machine,
                   struct gt_error *error);

// CRC-32 over what decides the kinematics, as gt_l2_checksum.
gt_code gt_f1_checksum(const struct gt_f1 *machine, uint32_t *checksum);

// Inverse kinematics: positions q (q-units; rad for the last three) for a pose.
// `seed`: q4, q5, q6 to start from, those of the last cycle; null: 0. `solved` may be null.
// Bounded: at most GT_COLD_SOLVES linear solves of each cluster, fewer from a near seed.
//
// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, NOT_CONVERGED, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE. `q` is then not written.
//
gt_code gt_f1_inverse(const struct gt_f1 *machine,
                      const struct gt_pose *pose,
                      const double seed[3],
                      double q[6],
                      struct gt_solved *solved,
                      struct gt_error *error);

// Forward kinematics: the pose for positions q (q-units).
// `seed`: a pose nearby, that of the last cycle, from which at most `most_solves` linear solves are made (GT_WARM_SOLVES,
// GT_COLD_SOLVES); null: start from the synchronised form, with GT_COLD_SOLVES. `solved` may be null; `pose` may be `seed`.
//
// Errors: KINEMATICS_: SEED_REQUIRED, NO_ASSEMBLY, NOT_CONVERGED, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE.
//
gt_code gt_f1_forward(const struct gt_f1 *machine,
                      const double q[6],
                      const struct gt_pose *seed,
                      uint8_t most_solves,
                      struct gt_pose *pose,
                      struct gt_solved *solved,
                      struct gt_error *error);

// The Jacobian: the platform's twist (translation over rotation, world axes) per axis, 36 numbers row by row; m and rad per q-unit.
// `pose` and `q` belong together (gt_f1_inverse, gt_f1_forward); that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_f1_jacobian(const struct gt_f1 *machine,
                       const struct gt_pose *pose,
                       const double q[6],
                       double jacobian[36],
                       struct gt_error *error);

// Statics: tensions of the links (N, link order) and loads on the axes (N times m per q-unit, N m for plates; positive along +q).
// `pose` and `q` belong together; that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_f1_statics(const struct gt_f1 *machine,
                      const struct gt_pose *pose,
                      const double q[6],
                      const struct gt_wrench *load,
                      double link_forces_n[6],
                      double axis_loads[6],
                      struct gt_error *error);

// Makes a machine in `memory`: checks every number and the Tau property, once.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_L2_SIZE bytes. `machine`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_BRANCH (index 3: forward_branch), those of ROBOT_ and NOMINAL_: the first found.
gt_code gt_l2_init(void *memory,
                   size_t size,
                   const struct gt_l2_geometry *geometry,
                   struct gt_l2 **machine,
                   struct gt_error *error);

// CRC-32 over what decides the kinematics; `checksum` of a server is compared with the client's. wire.md says over what.
gt_code gt_l2_checksum(const struct gt_l2 *machine,
                       uint32_t *checksum);

// Inverse kinematics: positions q (q-units) that put the tool centre point at tcp_m (world axes, m), for a tool on the machine's side
// of the carts' plane. Closed form, constant cost.
//
// Errors: KINEMATICS_: UNREACHABLE, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE. `q` is then not written.
//
gt_code gt_l2_inverse(const struct gt_l2 *machine,
                      const double tcp_m[3],
                      double q[3],
                      struct gt_error *error);

// Forward kinematics: where the tool centre point is (world axes, m) for positions q (q-units). Closed form, constant cost.
//
// Errors: KINEMATICS_: NO_ASSEMBLY, SINGULAR, OUT_OF_RANGE, OTHER_BRANCH, NOT_FINITE.
//
gt_code gt_l2_forward(const struct gt_l2 *machine,
                      const double q[3],
                      double tcp_m[3],
                      struct gt_error *error);

// The Jacobian dT/dq at tcp_m, 9 numbers row by row: m per q-unit, world axes.
//
// Errors: as gt_l2_inverse.
//
gt_code gt_l2_jacobian(const struct gt_l2 *machine, const double tcp_m[3], double jacobian[9], struct gt_error *error);

// Statics: tensions of the links (N, link order) and loads on the carts (N times m per q-unit, positive along +q), under a load.
// tcp_m and q belong together (gt_l2_inverse, gt_l2_forward); that is not checked.
//
// Errors: KINEMATICS_: SINGULAR, NOT_FINITE.
//
gt_code gt_l2_statics(const struct gt_l2 *machine,
                      const double tcp_m[3],
                      const double q[3],
                      const struct gt_wrench *load,
                      double link_forces_n[6],
                      double cart_loads[3],
                      struct gt_error *error);

// A length in whole nanometres: the nearest, halves away from zero. The one way from the float world to references.
//
// Errors: those of CROSSING_ (NaN, infinite, or 2^53 nm and more).
gt_code gt_position_from_metres(double metres, int64_t *position_nm, struct gt_error *error);

// Makes a sensor in `memory`; it starts with its tare.
//
// `memory`, `size`: aligned to GT_ALIGN, at least GT_SENSOR_SIZE bytes. `sensor`: receives the handle.
//
// Errors: GT_CODE_MEMORY_TOO_SMALL, GT_CODE_SENSOR_NOT_ROTATION, GT_CODE_SENSOR_OUT_OF_RANGE: the first found.
gt_code gt_sensor_init(void *memory,
                       size_t size,
                       const struct gt_sensor_config *config,
                       struct gt_sensor **sensor,
                       struct gt_error *error);

// Takes one raw sample (sensor axes, about the sensor's origin), once per cycle.
// `taring` receives the samples that the tare still needs; when it is 0, `load` receives the load on the platform, world axes, about
// the tool centre point, filtered, otherwise zeros. Constant cost.
//
// Errors: GT_CODE_SENSOR_BAD_READING; nothing is changed then.
gt_code gt_sensor_update(struct gt_sensor *sensor,
                         const struct gt_wrench *raw,
                         struct gt_wrench *load,
                         uint32_t *taring);

// Starts over: tare first, filter at zero. The tool must be unloaded.
gt_code gt_sensor_restart(struct gt_sensor *sensor);

// Fills a configuration with the profile of the thesis: 1 kHz, one lost Command tolerated, position offsets of at most 2 mm that change
// by at most 5 um per tick and go back to zero by 0.1 um per tick, no velocity or torque offsets, one motor per axis, no black box.
// Travel and nominal_step_nm are 0 and must be set: no machine is assumed. `axes`: 3 or 6.
//
// Errors: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_CONFIG_AXES.
gt_code gt_server_config_thesis(struct gt_server_config *config,
                                uint32_t axes);

// Checks a configuration, and says how many bytes its server needs here, at most GT_SERVER_SIZE_6_BLACK_BOX.
// `size` may be null.
//
// Errors: GT_CODE_BLACK_BOX, GT_CODE_MOTOR_COUNT, those of LIMITS_, CONFIG_ and MOTOR_MAP: the first found.
gt_code gt_server_config_check(const struct gt_server_config *config, size_t *size, struct gt_error *error);

// Makes a server in `memory`, without connections. Offsets that the drives still have in force start in GT_PHASE_SAFE_DISCONNECT.
// Nothing is to be freed: memory of a server that is no longer used can be used again.
//
// `memory`, `size`: aligned to GT_ALIGN (GT_MEMORY, malloc), at least GT_SERVER_SIZE_... bytes; what it holds does not matter.
// `server`: receives the handle, which points into `memory`.
//
// Errors: those of gt_server_config_check; GT_CODE_MEMORY_TOO_SMALL, GT_CODE_MISALIGNED, GT_CODE_START_OFFSET_IN_FORCE.
// After an error nothing in the memory is to be used, a server that was there before included.
gt_code gt_server_init(void *memory,
                       size_t size,
                       const struct gt_server_config *config,
                       const struct gt_start *start,
                       struct gt_server **server,
                       struct gt_error *error);

// Registers a connection that the caller has accepted. `transport`: GT_TRANSPORT_STREAM or GT_TRANSPORT_DATAGRAM.
// `connection` receives its number, which is never given twice.
//
// Errors: GT_CODE_TRANSPORT; GT_CODE_FULL: GT_MAX_CONNECTIONS are open, send gt_server_refusal and close.
gt_code gt_server_open(struct gt_server *server, uint32_t transport, uint64_t *connection);

// The frame for a peer for whom there is no room; its `connection` has no meaning.
gt_code gt_server_refusal(struct gt_frame *frame);

// Says that a connection is gone: closed by its peer, reset, or because a frame could not be written to it whole.
// One that is not open is ignored.
gt_code gt_server_close(struct gt_server *server, uint64_t connection);

// Takes bytes that were read from a connection: for a stream any piece of it, for datagrams exactly one.
// The work is bounded by `length`; what exceeds a connection's budget of frames per tick is not read (8 of the owner: a ninth ends
// the session; 1 of others: they are closed). A connection that is not open is ignored.
//
// `frames` receives how many frames the coming tick has of this connection; it may be null.
gt_code gt_server_feed(struct gt_server *server,
                       uint64_t connection,
                       const uint8_t *bytes,
                       size_t length,
                       uint8_t *frames);

// Lock-step: `answered` receives 1 if the coming tick has what it waits for (a Command that answers the last State, or something of
// the owner's that ends the session), else 0.
gt_code gt_server_owner_has_answered(struct gt_server *server,
                                     uint8_t *answered);

// One cycle: everything that was fed since the last tick is heard, then one step is taken. Its work is bounded, whatever arrived, and
// it takes the same path of memory every time: no allocation, no lock, no clock.
//
// Call it once per cycle, then write `turn->motors` to the drives, then fetch and write the frames, then close what `turn->close` names.
// What the drives do when no tick comes is their watchdog's business.
//
// An error changes nothing: GT_CODE_NULL_POINTER, GT_CODE_MISALIGNED, GT_CODE_NO_OBJECT.
gt_code gt_server_tick(struct gt_server *server,
                       const struct gt_cycle *cycle,
                       struct gt_turn *turn);

// Frame `index` of the last tick, 0 to frame_count - 1, in the order in which they are to be written: refusals, the Welcome, the State.
// It is copied; it can be fetched again until the next tick.
//
// Errors: GT_CODE_INDEX.
gt_code gt_server_frame(struct gt_server *server,
                        uint32_t index,
                        struct gt_frame *frame);

// The drives did not take the last references, and have these offsets in force instead (GT_MAX_AXES entries, of which the machine's
// are looked at). The channels go on from them at rest, without a step; the session is over, and the black box begins anew.
//
// Errors: GT_CODE_START_OFFSET_IN_FORCE; nothing is changed then.
gt_code gt_server_resume(struct gt_server *server,
                         const struct gt_offsets *in_force,
                         struct gt_error *error);

// What the black box holds. Without one: 0 ticks, never frozen.
gt_code gt_server_black_box(struct gt_server *server, struct gt_black_box *black_box);

// Line `index` of the black box as a file, 0 to `lines` - 1 of gt_black_box: JSON that ends with a newline, without a zero after it.
// All lines in order are a file that `gantry-tau replay` runs again, bit for bit. A frozen box does not change, so that a
// program can write a line per cycle; one that still records is to be read between two ticks, whole.
//
// `buffer`, `size`: initialised memory, GT_BLACK_BOX_LINE bytes at most; null with size 0 to ask for the length.
// `length`: receives the length of the line, whether it fits or not.
//
// Errors: GT_CODE_INDEX; GT_CODE_BUFFER_TOO_SMALL: the buffer has the beginning of the line.
gt_code gt_server_black_box_line(struct gt_server *server,
                                 uint32_t index,
                                 char *buffer,
                                 size_t size,
                                 size_t *length);

// Forgets what the black box holds, and records again: after its lines are written, and when a new session was granted.
gt_code gt_server_black_box_release(struct gt_server *server);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GANTRY_TAU_H */
