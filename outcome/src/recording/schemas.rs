//! ROS 2 definitions of all recorded messages, each with the types that it contains. `phalanx_msgs/Metrics` is
//! defined here in the same format.

/// A message type and all types that it contains.
pub(crate) struct Schema<F = &'static str> {
    /// ROS 2 name of the type.
    pub(crate) name: &'static str,
    fields: F,
    contained_types: &'static [&'static TypeDefinition],
}

/// Name and fields of a type that messages contain.
struct TypeDefinition(&'static str, &'static str);

/// Encoding of all definitions.
pub(crate) const ENCODING: &str = "ros2msg";

impl<F: AsRef<str>> Schema<F> {
    /// Returns the full definition: the fields, then each contained type under its name.
    pub(crate) fn definition_text(&self) -> String {
        let mut text = self.fields.as_ref().to_owned();
        for TypeDefinition(name, fields) in self.contained_types {
            text += &format!("{}\nMSG: {name}\n{fields}", "=".repeat(80));
        }
        text
    }
}

const TIME: TypeDefinition =
    TypeDefinition("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const HEADER: TypeDefinition =
    TypeDefinition("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const VECTOR: TypeDefinition =
    TypeDefinition("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
const POINT: TypeDefinition =
    TypeDefinition("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
const QUATERNION: TypeDefinition = TypeDefinition(
    "geometry_msgs/Quaternion",
    "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
);
const POSE: TypeDefinition = TypeDefinition(
    "geometry_msgs/Pose",
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
);
const TWIST: TypeDefinition = TypeDefinition(
    "geometry_msgs/Twist",
    "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
);
const POSE_WITH_COVARIANCE: TypeDefinition = TypeDefinition(
    "geometry_msgs/PoseWithCovariance",
    "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
);
const TWIST_WITH_COVARIANCE: TypeDefinition = TypeDefinition(
    "geometry_msgs/TwistWithCovariance",
    "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
);
const TRANSFORM: TypeDefinition = TypeDefinition(
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
);
const TRANSFORM_STAMPED: TypeDefinition = TypeDefinition(
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
);

const COLOR: TypeDefinition =
    TypeDefinition("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n");
const DURATION: TypeDefinition =
    TypeDefinition("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n");
const IMAGE: TypeDefinition = TypeDefinition(
    "sensor_msgs/CompressedImage",
    "std_msgs/Header header\nstring format\nuint8[] data\n",
);
const UV: TypeDefinition =
    TypeDefinition("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n");
const MESH: TypeDefinition =
    TypeDefinition("visualization_msgs/MeshFile", "string filename\nuint8[] data\n");
const MARKER: TypeDefinition = TypeDefinition(
    "visualization_msgs/Marker",
    "int32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 ADD=0\n\
     std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
     geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
     builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
     std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n\
     visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n\
     visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
);

/// Schema of `/walls`.
pub(crate) const WALLS: Schema = Schema {
    name: "visualization_msgs/msg/MarkerArray",
    fields: "visualization_msgs/Marker[] markers\n",
    contained_types: &[
        &MARKER,
        &HEADER,
        &TIME,
        &POSE,
        &POINT,
        &QUATERNION,
        &VECTOR,
        &COLOR,
        &DURATION,
        &IMAGE,
        &UV,
        &MESH,
    ],
};

/// Schema of `/tf`.
pub(crate) const TF: Schema = Schema {
    name: "tf2_msgs/msg/TFMessage",
    fields: "geometry_msgs/TransformStamped[] transforms\n",
    contained_types: &[&TRANSFORM_STAMPED, &HEADER, &TIME, &TRANSFORM, &VECTOR, &QUATERNION],
};

/// Schema of `/<robot>/odom`.
pub(crate) const ODOMETRY: Schema = Schema {
    name: "nav_msgs/msg/Odometry",
    fields: "std_msgs/Header header\nstring child_frame_id\n\
             geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    contained_types: &[
        &HEADER,
        &TIME,
        &POSE_WITH_COVARIANCE,
        &POSE,
        &POINT,
        &QUATERNION,
        &TWIST_WITH_COVARIANCE,
        &TWIST,
        &VECTOR,
    ],
};

/// Schema of `/<robot>/pose`.
pub(crate) const POSE_STAMPED: Schema = Schema {
    name: "geometry_msgs/msg/PoseStamped",
    fields: "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    contained_types: &[&HEADER, &TIME, &POSE, &POINT, &QUATERNION],
};

/// Schema of `/<robot>/cmd_vel`.
pub(crate) const COMMAND: Schema =
    Schema { name: "geometry_msgs/msg/Twist", fields: TWIST.1, contained_types: &[&VECTOR] };

/// Schema of `/<robot>/signals`.
pub(crate) const SIGNALS: Schema = Schema {
    name: "phalanx_msgs/msg/Signals",
    fields: "# Numbers that the control law of the robot recorded.\nphalanx_msgs/Signal[] signals\n",
    contained_types: &[&SIGNAL, &TIME],
};

const SIGNAL: TypeDefinition = TypeDefinition(
    "phalanx_msgs/Signal",
    "# Time of the odometry sample at which the value was recorded.\nbuiltin_interfaces/Time stamp\n\
     string name\nfloat64 value\n",
);

/// Schema of `/<robot>/messages`.
pub(crate) const LAW_MESSAGE: Schema = Schema {
    name: "phalanx_msgs/msg/LawMessage",
    fields: "# Message that the control law of the robot sent to its out-neighbors.\n\
             # Time of the odometry sample whose answer it left with.\nbuiltin_interfaces/Time stamp\n\
             # Arrays of numbers, in the order of their declaration.\n\
             phalanx_msgs/MessageArray[] arrays\n\
             # Bytes of a message without a structure.\nuint8[] bytes\n",
    contained_types: &[&TIME, &MESSAGE_ARRAY],
};

const MESSAGE_ARRAY: TypeDefinition = TypeDefinition(
    "phalanx_msgs/MessageArray",
    "string name\n# Numbers, row by row.\nfloat64[] values\n",
);

/// Schema of `/rosout`.
pub(crate) const LOG: Schema = Schema {
    name: "rcl_interfaces/msg/Log",
    fields: "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n\
             builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n\
             string function\nuint32 line\n",
    contained_types: &[&TIME],
};

/// Returns the schema of `/metrics`, whose last fields are these columns.
pub(crate) fn metrics_schema(columns: &str) -> Schema<String> {
    let fields = METRICS_FIELDS.to_owned() + columns;
    Schema { name: "phalanx_msgs/msg/Metrics", fields, contained_types: &[&TIME] }
}

/// First fields of `/metrics`.
const METRICS_FIELDS: &str = "# Distances and errors of all robots at one instant, in SI units.\n\
             builtin_interfaces/Time stamp\n\
             # Smallest distance between two front points, m; NaN with fewer than two robots.\n\
             float64 min_distance_m\n\
             # Between which two: places in the lists below, from 0.\n\
             uint32[2] min_distance_pair\n\
             # Names in the scenario's order; so are the lists below.\n\
             string[] robot\n";
