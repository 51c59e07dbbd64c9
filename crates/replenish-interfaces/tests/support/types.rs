//! Every message, and every part of a service or action, of the crate. `cover` checks that none is
//! missing.

/// Calls `$each!(Type)` with the full path of every type.
macro_rules! for_each_type {
    ($each:ident) => {
        $crate::types::listed! { $each
            action_msgs::msg { GoalInfo GoalStatus GoalStatusArray }
            action_msgs::srv { CancelGoalRequest CancelGoalResponse }
            actionlib_msgs::msg { GoalID GoalStatus GoalStatusArray }
            builtin_interfaces::msg { Duration Time }
            composition_interfaces::srv { ListNodesRequest ListNodesResponse LoadNodeRequest
                LoadNodeResponse UnloadNodeRequest UnloadNodeResponse }
            diagnostic_msgs::msg { DiagnosticArray DiagnosticStatus KeyValue }
            diagnostic_msgs::srv { AddDiagnosticsRequest AddDiagnosticsResponse SelfTestRequest
                SelfTestResponse }
            example_interfaces::action { FibonacciGoal FibonacciResult FibonacciFeedback }
            example_interfaces::msg { Bool Byte ByteMultiArray Char Empty Float32
                Float32MultiArray Float64 Float64MultiArray Int16 Int16MultiArray Int32
                Int32MultiArray Int64 Int64MultiArray Int8 Int8MultiArray MultiArrayDimension
                MultiArrayLayout String UInt16 UInt16MultiArray UInt32 UInt32MultiArray UInt64
                UInt64MultiArray UInt8 UInt8MultiArray WString }
            example_interfaces::srv { AddTwoIntsRequest AddTwoIntsResponse SetBoolRequest
                SetBoolResponse TriggerRequest TriggerResponse }
            geometry_msgs::msg { Accel AccelStamped AccelWithCovariance
                AccelWithCovarianceStamped Inertia InertiaStamped Point Point32 PointStamped
                Polygon PolygonInstance PolygonInstanceStamped PolygonStamped Pose Pose2D
                PoseArray PoseStamped PoseWithCovariance PoseWithCovarianceStamped Quaternion
                QuaternionStamped Transform TransformStamped Twist TwistStamped
                TwistWithCovariance TwistWithCovarianceStamped Vector3 Vector3Stamped
                VelocityStamped Wrench WrenchStamped }
            lifecycle_msgs::msg { State Transition TransitionDescription TransitionEvent }
            lifecycle_msgs::srv { ChangeStateRequest ChangeStateResponse
                GetAvailableStatesRequest GetAvailableStatesResponse
                GetAvailableTransitionsRequest GetAvailableTransitionsResponse GetStateRequest
                GetStateResponse }
            nav_msgs::msg { GridCells MapMetaData OccupancyGrid Odometry Path }
            nav_msgs::srv { GetMapRequest GetMapResponse GetPlanRequest GetPlanResponse
                LoadMapRequest LoadMapResponse SetMapRequest SetMapResponse }
            rcl_interfaces::msg { FloatingPointRange IntegerRange ListParametersResult Log
                LoggerLevel Parameter ParameterDescriptor ParameterEvent
                ParameterEventDescriptors ParameterType ParameterValue SetLoggerLevelsResult
                SetParametersResult }
            rcl_interfaces::srv { DescribeParametersRequest DescribeParametersResponse
                GetLoggerLevelsRequest GetLoggerLevelsResponse GetParameterTypesRequest
                GetParameterTypesResponse GetParametersRequest GetParametersResponse
                ListParametersRequest ListParametersResponse SetLoggerLevelsRequest
                SetLoggerLevelsResponse SetParametersRequest SetParametersResponse
                SetParametersAtomicallyRequest SetParametersAtomicallyResponse }
            rosgraph_msgs::msg { Clock }
            sensor_msgs::msg { BatteryState CameraInfo ChannelFloat32 CompressedImage
                FluidPressure Illuminance Image Imu JointState Joy JoyFeedback JoyFeedbackArray
                LaserEcho LaserScan MagneticField MultiDOFJointState MultiEchoLaserScan
                NavSatFix NavSatStatus PointCloud PointCloud2 PointField Range RegionOfInterest
                RelativeHumidity Temperature TimeReference }
            sensor_msgs::srv { SetCameraInfoRequest SetCameraInfoResponse }
            service_msgs::msg { ServiceEventInfo }
            shape_msgs::msg { Mesh MeshTriangle Plane SolidPrimitive }
            statistics_msgs::msg { MetricsMessage StatisticDataPoint StatisticDataType }
            std_msgs::msg { Bool Byte ByteMultiArray Char ColorRGBA Empty Float32
                Float32MultiArray Float64 Float64MultiArray Header Int16 Int16MultiArray Int32
                Int32MultiArray Int64 Int64MultiArray Int8 Int8MultiArray MultiArrayDimension
                MultiArrayLayout String UInt16 UInt16MultiArray UInt32 UInt32MultiArray UInt64
                UInt64MultiArray UInt8 UInt8MultiArray }
            std_srvs::srv { EmptyRequest EmptyResponse SetBoolRequest SetBoolResponse
                TriggerRequest TriggerResponse }
            stereo_msgs::msg { DisparityImage }
            test_msgs::action { FibonacciGoal FibonacciResult FibonacciFeedback
                NestedMessageGoal NestedMessageResult NestedMessageFeedback }
            test_msgs::msg { Arrays BasicTypes BoundedPlainSequences BoundedSequences Builtins
                Constants Defaults Empty MultiNested Nested Strings UnboundedSequences WStrings
                }
            test_msgs::srv { ArraysRequest ArraysResponse BasicTypesRequest BasicTypesResponse
                EmptyRequest EmptyResponse }
            tf2_msgs::action { LookupTransformGoal LookupTransformResult LookupTransformFeedback
                }
            tf2_msgs::msg { TF2Error TFMessage }
            tf2_msgs::srv { FrameGraphRequest FrameGraphResponse }
            trajectory_msgs::msg { JointTrajectory JointTrajectoryPoint MultiDOFJointTrajectory
                MultiDOFJointTrajectoryPoint }
            type_description_interfaces::msg { Field FieldType IndividualTypeDescription
                KeyValue TypeDescription TypeSource }
            type_description_interfaces::srv { GetTypeDescriptionRequest
                GetTypeDescriptionResponse }
            unique_identifier_msgs::msg { UUID }
            visualization_msgs::msg { ImageMarker InteractiveMarker InteractiveMarkerControl
                InteractiveMarkerFeedback InteractiveMarkerInit InteractiveMarkerPose
                InteractiveMarkerUpdate Marker MarkerArray MenuEntry MeshFile UVCoordinate }
            visualization_msgs::srv { GetInteractiveMarkersRequest GetInteractiveMarkersResponse
                }
        }
    };
}

macro_rules! listed {
    ($each:ident $($package:ident::$kind:ident { $($name:ident)* })*) => {
        $($($each!(replenish_interfaces::$package::$kind::$name);)*)*
    };
}

pub(crate) use {for_each_type, listed};
