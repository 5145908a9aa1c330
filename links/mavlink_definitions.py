"""What MAVLink's messages hold: those of the dialect ardupilotmega, which has all of ``common``.

A line is a message: its number, its name, then its fields in the order of the definition, each with its type as
:mod:`struct` writes it (B b H h I i Q q: whole numbers, f d: floats, s: text), behind the length of an array. Those
behind the bar came later (extensions): an older sender leaves them out. From pymavlink 2.4.50, by
tests/mavlink_definitions.py; a test holds them to the pymavlink that is installed.
"""

MESSAGES = """\
0 HEARTBEAT type:B autopilot:B base_mode:B custom_mode:I system_status:B mavlink_version:B
1 SYS_STATUS onboard_control_sensors_present:I onboard_control_sensors_enabled:I onboard_control_sensors_health:I load:H voltage_battery:H current_battery:h battery_remaining:b drop_rate_comm:H errors_comm:H errors_count1:H errors_count2:H errors_count3:H errors_count4:H | onboard_control_sensors_present_extended:I onboard_control_sensors_enabled_extended:I onboard_control_sensors_health_extended:I
2 SYSTEM_TIME time_unix_usec:Q time_boot_ms:I
4 PING time_usec:Q seq:I target_system:B target_component:B
5 CHANGE_OPERATOR_CONTROL target_system:B control_request:B version:B passkey:25s
6 CHANGE_OPERATOR_CONTROL_ACK gcs_system_id:B control_request:B ack:B
7 AUTH_KEY key:32s
11 SET_MODE target_system:B base_mode:B custom_mode:I
20 PARAM_REQUEST_READ target_system:B target_component:B param_id:16s param_index:h
21 PARAM_REQUEST_LIST target_system:B target_component:B
22 PARAM_VALUE param_id:16s param_value:f param_type:B param_count:H param_index:H
23 PARAM_SET target_system:B target_component:B param_id:16s param_value:f param_type:B
24 GPS_RAW_INT time_usec:Q fix_type:B lat:i lon:i alt:i eph:H epv:H vel:H cog:H satellites_visible:B | alt_ellipsoid:i h_acc:I v_acc:I vel_acc:I hdg_acc:I yaw:H
25 GPS_STATUS satellites_visible:B satellite_prn:20B satellite_used:20B satellite_elevation:20B satellite_azimuth:20B satellite_snr:20B
26 SCALED_IMU time_boot_ms:I xacc:h yacc:h zacc:h xgyro:h ygyro:h zgyro:h xmag:h ymag:h zmag:h | temperature:h
27 RAW_IMU time_usec:Q xacc:h yacc:h zacc:h xgyro:h ygyro:h zgyro:h xmag:h ymag:h zmag:h | id:B temperature:h
28 RAW_PRESSURE time_usec:Q press_abs:h press_diff1:h press_diff2:h temperature:h
29 SCALED_PRESSURE time_boot_ms:I press_abs:f press_diff:f temperature:h | temperature_press_diff:h
30 ATTITUDE time_boot_ms:I roll:f pitch:f yaw:f rollspeed:f pitchspeed:f yawspeed:f
31 ATTITUDE_QUATERNION time_boot_ms:I q1:f q2:f q3:f q4:f rollspeed:f pitchspeed:f yawspeed:f | repr_offset_q:4f
32 LOCAL_POSITION_NED time_boot_ms:I x:f y:f z:f vx:f vy:f vz:f
33 GLOBAL_POSITION_INT time_boot_ms:I lat:i lon:i alt:i relative_alt:i vx:h vy:h vz:h hdg:H
34 RC_CHANNELS_SCALED time_boot_ms:I port:B chan1_scaled:h chan2_scaled:h chan3_scaled:h chan4_scaled:h chan5_scaled:h chan6_scaled:h chan7_scaled:h chan8_scaled:h rssi:B
35 RC_CHANNELS_RAW time_boot_ms:I port:B chan1_raw:H chan2_raw:H chan3_raw:H chan4_raw:H chan5_raw:H chan6_raw:H chan7_raw:H chan8_raw:H rssi:B
36 SERVO_OUTPUT_RAW time_usec:I port:B servo1_raw:H servo2_raw:H servo3_raw:H servo4_raw:H servo5_raw:H servo6_raw:H servo7_raw:H servo8_raw:H | servo9_raw:H servo10_raw:H servo11_raw:H servo12_raw:H servo13_raw:H servo14_raw:H servo15_raw:H servo16_raw:H
37 MISSION_REQUEST_PARTIAL_LIST target_system:B target_component:B start_index:h end_index:h | mission_type:B
38 MISSION_WRITE_PARTIAL_LIST target_system:B target_component:B start_index:h end_index:h | mission_type:B
39 MISSION_ITEM target_system:B target_component:B seq:H frame:B command:H current:B autocontinue:B param1:f param2:f param3:f param4:f x:f y:f z:f | mission_type:B
40 MISSION_REQUEST target_system:B target_component:B seq:H | mission_type:B
41 MISSION_SET_CURRENT target_system:B target_component:B seq:H
42 MISSION_CURRENT seq:H | total:H mission_state:B mission_mode:B
43 MISSION_REQUEST_LIST target_system:B target_component:B | mission_type:B
44 MISSION_COUNT target_system:B target_component:B count:H | mission_type:B
45 MISSION_CLEAR_ALL target_system:B target_component:B | mission_type:B
46 MISSION_ITEM_REACHED seq:H
47 MISSION_ACK target_system:B target_component:B type:B | mission_type:B
48 SET_GPS_GLOBAL_ORIGIN target_system:B latitude:i longitude:i altitude:i | time_usec:Q
49 GPS_GLOBAL_ORIGIN latitude:i longitude:i altitude:i | time_usec:Q
50 PARAM_MAP_RC target_system:B target_component:B param_id:16s param_index:h parameter_rc_channel_index:B param_value0:f scale:f param_value_min:f param_value_max:f
51 MISSION_REQUEST_INT target_system:B target_component:B seq:H | mission_type:B
54 SAFETY_SET_ALLOWED_AREA target_system:B target_component:B frame:B p1x:f p1y:f p1z:f p2x:f p2y:f p2z:f
55 SAFETY_ALLOWED_AREA frame:B p1x:f p1y:f p1z:f p2x:f p2y:f p2z:f
61 ATTITUDE_QUATERNION_COV time_usec:Q q:4f rollspeed:f pitchspeed:f yawspeed:f covariance:9f
62 NAV_CONTROLLER_OUTPUT nav_roll:f nav_pitch:f nav_bearing:h target_bearing:h wp_dist:H alt_error:f aspd_error:f xtrack_error:f
63 GLOBAL_POSITION_INT_COV time_usec:Q estimator_type:B lat:i lon:i alt:i relative_alt:i vx:f vy:f vz:f covariance:36f
64 LOCAL_POSITION_NED_COV time_usec:Q estimator_type:B x:f y:f z:f vx:f vy:f vz:f ax:f ay:f az:f covariance:45f
65 RC_CHANNELS time_boot_ms:I chancount:B chan1_raw:H chan2_raw:H chan3_raw:H chan4_raw:H chan5_raw:H chan6_raw:H chan7_raw:H chan8_raw:H chan9_raw:H chan10_raw:H chan11_raw:H chan12_raw:H chan13_raw:H chan14_raw:H chan15_raw:H chan16_raw:H chan17_raw:H chan18_raw:H rssi:B
66 REQUEST_DATA_STREAM target_system:B target_component:B req_stream_id:B req_message_rate:H start_stop:B
67 DATA_STREAM stream_id:B message_rate:H on_off:B
69 MANUAL_CONTROL target:B x:h y:h z:h r:h buttons:H | buttons2:H enabled_extensions:B s:h t:h aux1:h aux2:h aux3:h aux4:h aux5:h aux6:h
70 RC_CHANNELS_OVERRIDE target_system:B target_component:B chan1_raw:H chan2_raw:H chan3_raw:H chan4_raw:H chan5_raw:H chan6_raw:H chan7_raw:H chan8_raw:H | chan9_raw:H chan10_raw:H chan11_raw:H chan12_raw:H chan13_raw:H chan14_raw:H chan15_raw:H chan16_raw:H chan17_raw:H chan18_raw:H
73 MISSION_ITEM_INT target_system:B target_component:B seq:H frame:B command:H current:B autocontinue:B param1:f param2:f param3:f param4:f x:i y:i z:f | mission_type:B
74 VFR_HUD airspeed:f groundspeed:f heading:h throttle:H alt:f climb:f
75 COMMAND_INT target_system:B target_component:B frame:B command:H current:B autocontinue:B param1:f param2:f param3:f param4:f x:i y:i z:f
76 COMMAND_LONG target_system:B target_component:B command:H confirmation:B param1:f param2:f param3:f param4:f param5:f param6:f param7:f
77 COMMAND_ACK command:H result:B | progress:B result_param2:i target_system:B target_component:B
81 MANUAL_SETPOINT time_boot_ms:I roll:f pitch:f yaw:f thrust:f mode_switch:B manual_override_switch:B
82 SET_ATTITUDE_TARGET time_boot_ms:I target_system:B target_component:B type_mask:B q:4f body_roll_rate:f body_pitch_rate:f body_yaw_rate:f thrust:f
83 ATTITUDE_TARGET time_boot_ms:I type_mask:B q:4f body_roll_rate:f body_pitch_rate:f body_yaw_rate:f thrust:f
84 SET_POSITION_TARGET_LOCAL_NED time_boot_ms:I target_system:B target_component:B coordinate_frame:B type_mask:H x:f y:f z:f vx:f vy:f vz:f afx:f afy:f afz:f yaw:f yaw_rate:f
85 POSITION_TARGET_LOCAL_NED time_boot_ms:I coordinate_frame:B type_mask:H x:f y:f z:f vx:f vy:f vz:f afx:f afy:f afz:f yaw:f yaw_rate:f
86 SET_POSITION_TARGET_GLOBAL_INT time_boot_ms:I target_system:B target_component:B coordinate_frame:B type_mask:H lat_int:i lon_int:i alt:f vx:f vy:f vz:f afx:f afy:f afz:f yaw:f yaw_rate:f
87 POSITION_TARGET_GLOBAL_INT time_boot_ms:I coordinate_frame:B type_mask:H lat_int:i lon_int:i alt:f vx:f vy:f vz:f afx:f afy:f afz:f yaw:f yaw_rate:f
89 LOCAL_POSITION_NED_SYSTEM_GLOBAL_OFFSET time_boot_ms:I x:f y:f z:f roll:f pitch:f yaw:f
90 HIL_STATE time_usec:Q roll:f pitch:f yaw:f rollspeed:f pitchspeed:f yawspeed:f lat:i lon:i alt:i vx:h vy:h vz:h xacc:h yacc:h zacc:h
91 HIL_CONTROLS time_usec:Q roll_ailerons:f pitch_elevator:f yaw_rudder:f throttle:f aux1:f aux2:f aux3:f aux4:f mode:B nav_mode:B
92 HIL_RC_INPUTS_RAW time_usec:Q chan1_raw:H chan2_raw:H chan3_raw:H chan4_raw:H chan5_raw:H chan6_raw:H chan7_raw:H chan8_raw:H chan9_raw:H chan10_raw:H chan11_raw:H chan12_raw:H rssi:B
93 HIL_ACTUATOR_CONTROLS time_usec:Q controls:16f mode:B flags:Q
100 OPTICAL_FLOW time_usec:Q sensor_id:B flow_x:h flow_y:h flow_comp_m_x:f flow_comp_m_y:f quality:B ground_distance:f | flow_rate_x:f flow_rate_y:f
101 GLOBAL_VISION_POSITION_ESTIMATE usec:Q x:f y:f z:f roll:f pitch:f yaw:f | covariance:21f reset_counter:B
102 VISION_POSITION_ESTIMATE usec:Q x:f y:f z:f roll:f pitch:f yaw:f | covariance:21f reset_counter:B
103 VISION_SPEED_ESTIMATE usec:Q x:f y:f z:f | covariance:9f reset_counter:B
104 VICON_POSITION_ESTIMATE usec:Q x:f y:f z:f roll:f pitch:f yaw:f | covariance:21f
105 HIGHRES_IMU time_usec:Q xacc:f yacc:f zacc:f xgyro:f ygyro:f zgyro:f xmag:f ymag:f zmag:f abs_pressure:f diff_pressure:f pressure_alt:f temperature:f fields_updated:H | id:B
106 OPTICAL_FLOW_RAD time_usec:Q sensor_id:B integration_time_us:I integrated_x:f integrated_y:f integrated_xgyro:f integrated_ygyro:f integrated_zgyro:f temperature:h quality:B time_delta_distance_us:I distance:f
107 HIL_SENSOR time_usec:Q xacc:f yacc:f zacc:f xgyro:f ygyro:f zgyro:f xmag:f ymag:f zmag:f abs_pressure:f diff_pressure:f pressure_alt:f temperature:f fields_updated:I | id:B
108 SIM_STATE q1:f q2:f q3:f q4:f roll:f pitch:f yaw:f xacc:f yacc:f zacc:f xgyro:f ygyro:f zgyro:f lat:f lon:f alt:f std_dev_horz:f std_dev_vert:f vn:f ve:f vd:f | lat_int:i lon_int:i
109 RADIO_STATUS rssi:B remrssi:B txbuf:B noise:B remnoise:B rxerrors:H fixed:H
110 FILE_TRANSFER_PROTOCOL target_network:B target_system:B target_component:B payload:251B
111 TIMESYNC tc1:q ts1:q
112 CAMERA_TRIGGER time_usec:Q seq:I
113 HIL_GPS time_usec:Q fix_type:B lat:i lon:i alt:i eph:H epv:H vel:H vn:h ve:h vd:h cog:H satellites_visible:B | id:B yaw:H
114 HIL_OPTICAL_FLOW time_usec:Q sensor_id:B integration_time_us:I integrated_x:f integrated_y:f integrated_xgyro:f integrated_ygyro:f integrated_zgyro:f temperature:h quality:B time_delta_distance_us:I distance:f
115 HIL_STATE_QUATERNION time_usec:Q attitude_quaternion:4f rollspeed:f pitchspeed:f yawspeed:f lat:i lon:i alt:i vx:h vy:h vz:h ind_airspeed:H true_airspeed:H xacc:h yacc:h zacc:h
116 SCALED_IMU2 time_boot_ms:I xacc:h yacc:h zacc:h xgyro:h ygyro:h zgyro:h xmag:h ymag:h zmag:h | temperature:h
117 LOG_REQUEST_LIST target_system:B target_component:B start:H end:H
118 LOG_ENTRY id:H num_logs:H last_log_num:H time_utc:I size:I
119 LOG_REQUEST_DATA target_system:B target_component:B id:H ofs:I count:I
120 LOG_DATA id:H ofs:I count:B data:90B
121 LOG_ERASE target_system:B target_component:B
122 LOG_REQUEST_END target_system:B target_component:B
123 GPS_INJECT_DATA target_system:B target_component:B len:B data:110B
124 GPS2_RAW time_usec:Q fix_type:B lat:i lon:i alt:i eph:H epv:H vel:H cog:H satellites_visible:B dgps_numch:B dgps_age:I | yaw:H alt_ellipsoid:i h_acc:I v_acc:I vel_acc:I hdg_acc:I
125 POWER_STATUS Vcc:H Vservo:H flags:H
126 SERIAL_CONTROL device:B flags:B timeout:H baudrate:I count:B data:70B
127 GPS_RTK time_last_baseline_ms:I rtk_receiver_id:B wn:H tow:I rtk_health:B rtk_rate:B nsats:B baseline_coords_type:B baseline_a_mm:i baseline_b_mm:i baseline_c_mm:i accuracy:I iar_num_hypotheses:i
128 GPS2_RTK time_last_baseline_ms:I rtk_receiver_id:B wn:H tow:I rtk_health:B rtk_rate:B nsats:B baseline_coords_type:B baseline_a_mm:i baseline_b_mm:i baseline_c_mm:i accuracy:I iar_num_hypotheses:i
129 SCALED_IMU3 time_boot_ms:I xacc:h yacc:h zacc:h xgyro:h ygyro:h zgyro:h xmag:h ymag:h zmag:h | temperature:h
130 DATA_TRANSMISSION_HANDSHAKE type:B size:I width:H height:H packets:H payload:B jpg_quality:B
131 ENCAPSULATED_DATA seqnr:H data:253B
132 DISTANCE_SENSOR time_boot_ms:I min_distance:H max_distance:H current_distance:H type:B id:B orientation:B covariance:B | horizontal_fov:f vertical_fov:f quaternion:4f signal_quality:B
133 TERRAIN_REQUEST lat:i lon:i grid_spacing:H mask:Q
134 TERRAIN_DATA lat:i lon:i grid_spacing:H gridbit:B data:16h
135 TERRAIN_CHECK lat:i lon:i
136 TERRAIN_REPORT lat:i lon:i spacing:H terrain_height:f current_height:f pending:H loaded:H
137 SCALED_PRESSURE2 time_boot_ms:I press_abs:f press_diff:f temperature:h | temperature_press_diff:h
138 ATT_POS_MOCAP time_usec:Q q:4f x:f y:f z:f | covariance:21f
139 SET_ACTUATOR_CONTROL_TARGET time_usec:Q group_mlx:B target_system:B target_component:B controls:8f
140 ACTUATOR_CONTROL_TARGET time_usec:Q group_mlx:B controls:8f
141 ALTITUDE time_usec:Q altitude_monotonic:f altitude_amsl:f altitude_local:f altitude_relative:f altitude_terrain:f bottom_clearance:f
142 RESOURCE_REQUEST request_id:B uri_type:B uri:120B transfer_type:B storage:120B
143 SCALED_PRESSURE3 time_boot_ms:I press_abs:f press_diff:f temperature:h | temperature_press_diff:h
144 FOLLOW_TARGET timestamp:Q est_capabilities:B lat:i lon:i alt:f vel:3f acc:3f attitude_q:4f rates:3f position_cov:3f custom_state:Q
146 CONTROL_SYSTEM_STATE time_usec:Q x_acc:f y_acc:f z_acc:f x_vel:f y_vel:f z_vel:f x_pos:f y_pos:f z_pos:f airspeed:f vel_variance:3f pos_variance:3f q:4f roll_rate:f pitch_rate:f yaw_rate:f
147 BATTERY_STATUS id:B battery_function:B type:B temperature:h voltages:10H current_battery:h current_consumed:i energy_consumed:i battery_remaining:b | time_remaining:i charge_state:B voltages_ext:4H mode:B fault_bitmask:I
148 AUTOPILOT_VERSION capabilities:Q flight_sw_version:I middleware_sw_version:I os_sw_version:I board_version:I flight_custom_version:8B middleware_custom_version:8B os_custom_version:8B vendor_id:H product_id:H uid:Q | uid2:18B
149 LANDING_TARGET time_usec:Q target_num:B frame:B angle_x:f angle_y:f distance:f size_x:f size_y:f | x:f y:f z:f q:4f type:B position_valid:B
150 SENSOR_OFFSETS mag_ofs_x:h mag_ofs_y:h mag_ofs_z:h mag_declination:f raw_press:i raw_temp:i gyro_cal_x:f gyro_cal_y:f gyro_cal_z:f accel_cal_x:f accel_cal_y:f accel_cal_z:f
151 SET_MAG_OFFSETS target_system:B target_component:B mag_ofs_x:h mag_ofs_y:h mag_ofs_z:h
152 MEMINFO brkval:H freemem:H | freemem32:I
153 AP_ADC adc1:H adc2:H adc3:H adc4:H adc5:H adc6:H
154 DIGICAM_CONFIGURE target_system:B target_component:B mode:B shutter_speed:H aperture:B iso:B exposure_type:B command_id:B engine_cut_off:B extra_param:B extra_value:f
155 DIGICAM_CONTROL target_system:B target_component:B session:B zoom_pos:B zoom_step:b focus_lock:B shot:B command_id:B extra_param:B extra_value:f
156 MOUNT_CONFIGURE target_system:B target_component:B mount_mode:B stab_roll:B stab_pitch:B stab_yaw:B
157 MOUNT_CONTROL target_system:B target_component:B input_a:i input_b:i input_c:i save_position:B
158 MOUNT_STATUS target_system:B target_component:B pointing_a:i pointing_b:i pointing_c:i | mount_mode:B
160 FENCE_POINT target_system:B target_component:B idx:B count:B lat:f lng:f
161 FENCE_FETCH_POINT target_system:B target_component:B idx:B
162 FENCE_STATUS breach_status:B breach_count:H breach_type:B breach_time:I | breach_mitigation:B
163 AHRS omegaIx:f omegaIy:f omegaIz:f accel_weight:f renorm_val:f error_rp:f error_yaw:f
164 SIMSTATE roll:f pitch:f yaw:f xacc:f yacc:f zacc:f xgyro:f ygyro:f zgyro:f lat:i lng:i
165 HWSTATUS Vcc:H I2Cerr:B
166 RADIO rssi:B remrssi:B txbuf:B noise:B remnoise:B rxerrors:H fixed:H
167 LIMITS_STATUS limits_state:B last_trigger:I last_action:I last_recovery:I last_clear:I breach_count:H mods_enabled:B mods_required:B mods_triggered:B
168 WIND direction:f speed:f speed_z:f
169 DATA16 type:B len:B data:16B
170 DATA32 type:B len:B data:32B
171 DATA64 type:B len:B data:64B
172 DATA96 type:B len:B data:96B
173 RANGEFINDER distance:f voltage:f
174 AIRSPEED_AUTOCAL vx:f vy:f vz:f diff_pressure:f EAS2TAS:f ratio:f state_x:f state_y:f state_z:f Pax:f Pby:f Pcz:f
175 RALLY_POINT target_system:B target_component:B idx:B count:B lat:i lng:i alt:h break_alt:h land_dir:H flags:B
176 RALLY_FETCH_POINT target_system:B target_component:B idx:B
177 COMPASSMOT_STATUS throttle:H current:f interference:H CompensationX:f CompensationY:f CompensationZ:f
178 AHRS2 roll:f pitch:f yaw:f altitude:f lat:i lng:i
179 CAMERA_STATUS time_usec:Q target_system:B cam_idx:B img_idx:H event_id:B p1:f p2:f p3:f p4:f
180 CAMERA_FEEDBACK time_usec:Q target_system:B cam_idx:B img_idx:H lat:i lng:i alt_msl:f alt_rel:f roll:f pitch:f yaw:f foc_len:f flags:B | completed_captures:H
181 BATTERY2 voltage:H current_battery:h
182 AHRS3 roll:f pitch:f yaw:f altitude:f lat:i lng:i v1:f v2:f v3:f v4:f
183 AUTOPILOT_VERSION_REQUEST target_system:B target_component:B
184 REMOTE_LOG_DATA_BLOCK target_system:B target_component:B seqno:I data:200B
185 REMOTE_LOG_BLOCK_STATUS target_system:B target_component:B seqno:I status:B
186 LED_CONTROL target_system:B target_component:B instance:B pattern:B custom_len:B custom_bytes:24B
191 MAG_CAL_PROGRESS compass_id:B cal_mask:B cal_status:B attempt:B completion_pct:B completion_mask:10B direction_x:f direction_y:f direction_z:f
192 MAG_CAL_REPORT compass_id:B cal_mask:B cal_status:B autosaved:B fitness:f ofs_x:f ofs_y:f ofs_z:f diag_x:f diag_y:f diag_z:f offdiag_x:f offdiag_y:f offdiag_z:f | orientation_confidence:f old_orientation:B new_orientation:B scale_factor:f
193 EKF_STATUS_REPORT flags:H velocity_variance:f pos_horiz_variance:f pos_vert_variance:f compass_variance:f terrain_alt_variance:f | airspeed_variance:f
194 PID_TUNING axis:B desired:f achieved:f FF:f P:f I:f D:f | SRate:f PDmod:f
195 DEEPSTALL landing_lat:i landing_lon:i path_lat:i path_lon:i arc_entry_lat:i arc_entry_lon:i altitude:f expected_travel_distance:f cross_track_error:f stage:B
200 GIMBAL_REPORT target_system:B target_component:B delta_time:f delta_angle_x:f delta_angle_y:f delta_angle_z:f delta_velocity_x:f delta_velocity_y:f delta_velocity_z:f joint_roll:f joint_el:f joint_az:f
201 GIMBAL_CONTROL target_system:B target_component:B demanded_rate_x:f demanded_rate_y:f demanded_rate_z:f
214 GIMBAL_TORQUE_CMD_REPORT target_system:B target_component:B rl_torque_cmd:h el_torque_cmd:h az_torque_cmd:h
215 GOPRO_HEARTBEAT status:B capture_mode:B flags:B
216 GOPRO_GET_REQUEST target_system:B target_component:B cmd_id:B
217 GOPRO_GET_RESPONSE cmd_id:B status:B value:4B
218 GOPRO_SET_REQUEST target_system:B target_component:B cmd_id:B value:4B
219 GOPRO_SET_RESPONSE cmd_id:B status:B
225 EFI_STATUS health:B ecu_index:f rpm:f fuel_consumed:f fuel_flow:f engine_load:f throttle_position:f spark_dwell_time:f barometric_pressure:f intake_manifold_pressure:f intake_manifold_temperature:f cylinder_head_temperature:f ignition_timing:f injection_time:f exhaust_gas_temperature:f throttle_out:f pt_compensation:f | ignition_voltage:f fuel_pressure:f
226 RPM rpm1:f rpm2:f
230 ESTIMATOR_STATUS time_usec:Q flags:H vel_ratio:f pos_horiz_ratio:f pos_vert_ratio:f mag_ratio:f hagl_ratio:f tas_ratio:f pos_horiz_accuracy:f pos_vert_accuracy:f
231 WIND_COV time_usec:Q wind_x:f wind_y:f wind_z:f var_horiz:f var_vert:f wind_alt:f horiz_accuracy:f vert_accuracy:f
232 GPS_INPUT time_usec:Q gps_id:B ignore_flags:H time_week_ms:I time_week:H fix_type:B lat:i lon:i alt:f hdop:f vdop:f vn:f ve:f vd:f speed_accuracy:f horiz_accuracy:f vert_accuracy:f satellites_visible:B | yaw:H
233 GPS_RTCM_DATA flags:B len:B data:180B
234 HIGH_LATENCY base_mode:B custom_mode:I landed_state:B roll:h pitch:h heading:H throttle:b heading_sp:h latitude:i longitude:i altitude_amsl:h altitude_sp:h airspeed:B airspeed_sp:B groundspeed:B climb_rate:b gps_nsat:B gps_fix_type:B battery_remaining:B temperature:b temperature_air:b failsafe:B wp_num:B wp_distance:H
235 HIGH_LATENCY2 timestamp:I type:B autopilot:B custom_mode:H latitude:i longitude:i altitude:h target_altitude:h heading:B target_heading:B target_distance:H throttle:B airspeed:B airspeed_sp:B groundspeed:B windspeed:B wind_heading:B eph:B epv:B temperature_air:b climb_rate:b battery:b wp_num:H failure_flags:H custom0:b custom1:b custom2:b
241 VIBRATION time_usec:Q vibration_x:f vibration_y:f vibration_z:f clipping_0:I clipping_1:I clipping_2:I
242 HOME_POSITION latitude:i longitude:i altitude:i x:f y:f z:f q:4f approach_x:f approach_y:f approach_z:f | time_usec:Q
243 SET_HOME_POSITION target_system:B latitude:i longitude:i altitude:i x:f y:f z:f q:4f approach_x:f approach_y:f approach_z:f | time_usec:Q
244 MESSAGE_INTERVAL message_id:H interval_us:i
245 EXTENDED_SYS_STATE vtol_state:B landed_state:B
246 ADSB_VEHICLE ICAO_address:I lat:i lon:i altitude_type:B altitude:i heading:H hor_velocity:H ver_velocity:h callsign:9s emitter_type:B tslc:B flags:H squawk:H
247 COLLISION src:B id:I action:B threat_level:B time_to_minimum_delta:f altitude_minimum_delta:f horizontal_minimum_delta:f
248 V2_EXTENSION target_network:B target_system:B target_component:B message_type:H payload:249B
249 MEMORY_VECT address:H ver:B type:B value:32b
250 DEBUG_VECT name:10s time_usec:Q x:f y:f z:f
251 NAMED_VALUE_FLOAT time_boot_ms:I name:10s value:f
252 NAMED_VALUE_INT time_boot_ms:I name:10s value:i
253 STATUSTEXT severity:B text:50s | id:H chunk_seq:B
254 DEBUG time_boot_ms:I ind:B value:f
256 SETUP_SIGNING target_system:B target_component:B secret_key:32B initial_timestamp:Q
257 BUTTON_CHANGE time_boot_ms:I last_change_ms:I state:B
258 PLAY_TUNE target_system:B target_component:B tune:30s | tune2:200s
259 CAMERA_INFORMATION time_boot_ms:I vendor_name:32B model_name:32B firmware_version:I focal_length:f sensor_size_h:f sensor_size_v:f resolution_h:H resolution_v:H lens_id:B flags:I cam_definition_version:H cam_definition_uri:140s | gimbal_device_id:B camera_device_id:B
260 CAMERA_SETTINGS time_boot_ms:I mode_id:B | zoomLevel:f focusLevel:f camera_device_id:B
261 STORAGE_INFORMATION time_boot_ms:I storage_id:B storage_count:B status:B total_capacity:f used_capacity:f available_capacity:f read_speed:f write_speed:f | type:B name:32s storage_usage:B
262 CAMERA_CAPTURE_STATUS time_boot_ms:I image_status:B video_status:B image_interval:f recording_time_ms:I available_capacity:f | image_count:i camera_device_id:B
263 CAMERA_IMAGE_CAPTURED time_boot_ms:I time_utc:Q camera_id:B lat:i lon:i alt:i relative_alt:i q:4f image_index:i capture_result:b file_url:205s
264 FLIGHT_INFORMATION time_boot_ms:I arming_time_utc:Q takeoff_time_utc:Q flight_uuid:Q | landing_time:I
265 MOUNT_ORIENTATION time_boot_ms:I roll:f pitch:f yaw:f | yaw_absolute:f
266 LOGGING_DATA target_system:B target_component:B sequence:H length:B first_message_offset:B data:249B
267 LOGGING_DATA_ACKED target_system:B target_component:B sequence:H length:B first_message_offset:B data:249B
268 LOGGING_ACK target_system:B target_component:B sequence:H
269 VIDEO_STREAM_INFORMATION stream_id:B count:B type:B flags:H framerate:f resolution_h:H resolution_v:H bitrate:I rotation:H hfov:H name:32s uri:160s | encoding:B camera_device_id:B
270 VIDEO_STREAM_STATUS stream_id:B flags:H framerate:f resolution_h:H resolution_v:H bitrate:I rotation:H hfov:H | camera_device_id:B
271 CAMERA_FOV_STATUS time_boot_ms:I lat_camera:i lon_camera:i alt_camera:i lat_image:i lon_image:i alt_image:i q:4f hfov:f vfov:f | camera_device_id:B
275 CAMERA_TRACKING_IMAGE_STATUS tracking_status:B tracking_mode:B target_data:B point_x:f point_y:f radius:f rec_top_x:f rec_top_y:f rec_bottom_x:f rec_bottom_y:f | camera_device_id:B
276 CAMERA_TRACKING_GEO_STATUS tracking_status:B lat:i lon:i alt:f h_acc:f v_acc:f vel_n:f vel_e:f vel_d:f vel_acc:f dist:f hdg:f hdg_acc:f | camera_device_id:B
277 CAMERA_THERMAL_RANGE time_boot_ms:I stream_id:B camera_device_id:B max:f max_point_x:f max_point_y:f min:f min_point_x:f min_point_y:f
280 GIMBAL_MANAGER_INFORMATION time_boot_ms:I cap_flags:I gimbal_device_id:B roll_min:f roll_max:f pitch_min:f pitch_max:f yaw_min:f yaw_max:f
281 GIMBAL_MANAGER_STATUS time_boot_ms:I flags:I gimbal_device_id:B primary_control_sysid:B primary_control_compid:B secondary_control_sysid:B secondary_control_compid:B
282 GIMBAL_MANAGER_SET_ATTITUDE target_system:B target_component:B flags:I gimbal_device_id:B q:4f angular_velocity_x:f angular_velocity_y:f angular_velocity_z:f
283 GIMBAL_DEVICE_INFORMATION time_boot_ms:I vendor_name:32s model_name:32s custom_name:32s firmware_version:I hardware_version:I uid:Q cap_flags:H custom_cap_flags:H roll_min:f roll_max:f pitch_min:f pitch_max:f yaw_min:f yaw_max:f | gimbal_device_id:B cap_flags2:I
284 GIMBAL_DEVICE_SET_ATTITUDE target_system:B target_component:B flags:H q:4f angular_velocity_x:f angular_velocity_y:f angular_velocity_z:f
285 GIMBAL_DEVICE_ATTITUDE_STATUS target_system:B target_component:B time_boot_ms:I flags:H q:4f angular_velocity_x:f angular_velocity_y:f angular_velocity_z:f failure_flags:I | delta_yaw:f delta_yaw_velocity:f gimbal_device_id:B
286 AUTOPILOT_STATE_FOR_GIMBAL_DEVICE target_system:B target_component:B time_boot_us:Q q:4f q_estimated_delay_us:I vx:f vy:f vz:f v_estimated_delay_us:I feed_forward_angular_velocity_z:f estimator_status:H landed_state:B | angular_velocity_z:f
287 GIMBAL_MANAGER_SET_PITCHYAW target_system:B target_component:B flags:I gimbal_device_id:B pitch:f yaw:f pitch_rate:f yaw_rate:f
288 GIMBAL_MANAGER_SET_MANUAL_CONTROL target_system:B target_component:B flags:I gimbal_device_id:B pitch:f yaw:f pitch_rate:f yaw_rate:f
295 AIRSPEED id:B airspeed:f temperature:h raw_press:f flags:B
296 GLOBAL_POSITION_SENSOR target_system:B target_component:B id:B time_usec:Q processing_time:I source:B flags:B lat:i lon:i alt_ellipsoid:f alt:f eph:f epv:f
299 WIFI_CONFIG_AP ssid:32s password:64s
301 AIS_VESSEL MMSI:I lat:i lon:i COG:H heading:H velocity:H turn_rate:b navigational_status:B type:B dimension_bow:H dimension_stern:H dimension_port:B dimension_starboard:B callsign:7s name:20s tslc:H flags:H
310 UAVCAN_NODE_STATUS time_usec:Q uptime_sec:I health:B mode:B sub_mode:B vendor_specific_status_code:H
311 UAVCAN_NODE_INFO time_usec:Q uptime_sec:I name:80s hw_version_major:B hw_version_minor:B hw_unique_id:16B sw_version_major:B sw_version_minor:B sw_vcs_commit:I
320 PARAM_EXT_REQUEST_READ target_system:B target_component:B param_id:16s param_index:h
321 PARAM_EXT_REQUEST_LIST target_system:B target_component:B
322 PARAM_EXT_VALUE param_id:16s param_value:128s param_type:B param_count:H param_index:H
323 PARAM_EXT_SET target_system:B target_component:B param_id:16s param_value:128s param_type:B
324 PARAM_EXT_ACK param_id:16s param_value:128s param_type:B param_result:B
330 OBSTACLE_DISTANCE time_usec:Q sensor_type:B distances:72H increment:B min_distance:H max_distance:H | increment_f:f angle_offset:f frame:B
331 ODOMETRY time_usec:Q frame_id:B child_frame_id:B x:f y:f z:f q:4f vx:f vy:f vz:f rollspeed:f pitchspeed:f yawspeed:f pose_covariance:21f velocity_covariance:21f | reset_counter:B estimator_type:B quality:b
332 TRAJECTORY_REPRESENTATION_WAYPOINTS time_usec:Q valid_points:B pos_x:5f pos_y:5f pos_z:5f vel_x:5f vel_y:5f vel_z:5f acc_x:5f acc_y:5f acc_z:5f pos_yaw:5f vel_yaw:5f command:5H
333 TRAJECTORY_REPRESENTATION_BEZIER time_usec:Q valid_points:B pos_x:5f pos_y:5f pos_z:5f delta:5f pos_yaw:5f
335 ISBD_LINK_STATUS timestamp:Q last_heartbeat:Q failed_sessions:H successful_sessions:H signal_quality:B ring_pending:B tx_session_pending:B rx_session_pending:B
339 RAW_RPM index:B frequency:f
340 UTM_GLOBAL_POSITION time:Q uas_id:18B lat:i lon:i alt:i relative_alt:i vx:h vy:h vz:h h_acc:H v_acc:H vel_acc:H next_lat:i next_lon:i next_alt:i update_rate:H flight_state:B flags:B
345 PARAM_ERROR target_system:B target_component:B param_id:16s param_index:h error:B
350 DEBUG_FLOAT_ARRAY time_usec:Q name:10s array_id:H | data:58f
360 ORBIT_EXECUTION_STATUS time_usec:Q radius:f frame:B x:i y:i z:f
370 SMART_BATTERY_INFO id:B battery_function:B type:B capacity_full_specification:i capacity_full:i cycle_count:H serial_number:16s device_name:50s weight:H discharge_minimum_voltage:H charging_minimum_voltage:H resting_minimum_voltage:H | charging_maximum_voltage:H cells_in_series:B discharge_maximum_current:I discharge_maximum_burst_current:I manufacture_date:11s
373 GENERATOR_STATUS status:Q generator_speed:H battery_current:f load_current:f power_generated:f bus_voltage:f rectifier_temperature:h bat_current_setpoint:f generator_temperature:h runtime:I time_until_maintenance:i
375 ACTUATOR_OUTPUT_STATUS time_usec:Q active:I actuator:32f
376 RELAY_STATUS time_boot_ms:I on:H present:H
385 TUNNEL target_system:B target_component:B payload_type:H payload_length:B payload:128B
386 CAN_FRAME target_system:B target_component:B bus:B len:B id:I data:8B
387 CANFD_FRAME target_system:B target_component:B bus:B len:B id:I data:64B
388 CAN_FILTER_MODIFY target_system:B target_component:B bus:B operation:B num_ids:B ids:16H
390 ONBOARD_COMPUTER_STATUS time_usec:Q uptime:I type:B cpu_cores:8B cpu_combined:10B gpu_cores:4B gpu_combined:10B temperature_board:b temperature_core:8b fan_speed:4h ram_usage:I ram_total:I storage_type:4I storage_usage:4I storage_total:4I link_type:6I link_tx_rate:6I link_rx_rate:6I link_tx_max:6I link_rx_max:6I | status_flags:H
9000 WHEEL_DISTANCE time_usec:Q count:B distance:16d
9005 WINCH_STATUS time_usec:Q line_length:f speed:f tension:f voltage:f current:f temperature:h status:I
10001 UAVIONIX_ADSB_OUT_CFG ICAO:I callsign:9s emitterType:B aircraftSize:B gpsOffsetLat:B gpsOffsetLon:B stallSpeed:H rfSelect:B
10002 UAVIONIX_ADSB_OUT_DYNAMIC utcTime:I gpsLat:i gpsLon:i gpsAlt:i gpsFix:B numSats:B baroAltMSL:i accuracyHor:I accuracyVert:H accuracyVel:H velVert:h velNS:h VelEW:h emergencyStatus:B state:H squawk:H
10003 UAVIONIX_ADSB_TRANSCEIVER_HEALTH_REPORT rfHealth:B
10004 UAVIONIX_ADSB_OUT_CFG_REGISTRATION registration:9s
10005 UAVIONIX_ADSB_OUT_CFG_FLIGHTID flight_id:9s
10006 UAVIONIX_ADSB_GET ReqMessageId:I
10007 UAVIONIX_ADSB_OUT_CONTROL state:B baroAltMSL:i squawk:H emergencyStatus:B flight_id:8s x_bit:B
10008 UAVIONIX_ADSB_OUT_STATUS state:B squawk:H NIC_NACp:B boardTemp:B fault:B flight_id:8s
10151 LOWEHEISER_GOV_EFI volt_batt:f curr_batt:f curr_gen:f curr_rot:f fuel_level:f throttle:f runtime:I until_maintenance:i rectifier_temp:f generator_temp:f efi_batt:f efi_rpm:f efi_pw:f efi_fuel_flow:f efi_fuel_consumed:f efi_baro:f efi_mat:f efi_clt:f efi_tps:f efi_exhaust_gas_temperature:f efi_index:B generator_status:H efi_status:H
11000 DEVICE_OP_READ target_system:B target_component:B request_id:I bustype:B bus:B address:B busname:40s regstart:B count:B | bank:B
11001 DEVICE_OP_READ_REPLY request_id:I result:B regstart:B count:B data:128B | bank:B
11002 DEVICE_OP_WRITE target_system:B target_component:B request_id:I bustype:B bus:B address:B busname:40s regstart:B count:B data:128B | bank:B
11003 DEVICE_OP_WRITE_REPLY request_id:I result:B
11004 SECURE_COMMAND target_system:B target_component:B sequence:I operation:I data_length:B sig_length:B data:220B
11005 SECURE_COMMAND_REPLY sequence:I operation:I result:B data_length:B data:220B
11010 ADAP_TUNING axis:B desired:f achieved:f error:f theta:f omega:f sigma:f theta_dot:f omega_dot:f sigma_dot:f f:f f_dot:f u:f
11011 VISION_POSITION_DELTA time_usec:Q time_delta_usec:Q angle_delta:3f position_delta:3f confidence:f
11020 AOA_SSA time_usec:Q AOA:f SSA:f
11030 ESC_TELEMETRY_1_TO_4 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11031 ESC_TELEMETRY_5_TO_8 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11032 ESC_TELEMETRY_9_TO_12 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11033 OSD_PARAM_CONFIG target_system:B target_component:B request_id:I osd_screen:B osd_index:B param_id:16s config_type:B min_value:f max_value:f increment:f
11034 OSD_PARAM_CONFIG_REPLY request_id:I result:B
11035 OSD_PARAM_SHOW_CONFIG target_system:B target_component:B request_id:I osd_screen:B osd_index:B
11036 OSD_PARAM_SHOW_CONFIG_REPLY request_id:I result:B param_id:16s config_type:B min_value:f max_value:f increment:f
11037 OBSTACLE_DISTANCE_3D time_boot_ms:I sensor_type:B frame:B obstacle_id:H x:f y:f z:f min_distance:f max_distance:f
11038 WATER_DEPTH time_boot_ms:I id:B healthy:B lat:i lng:i alt:f roll:f pitch:f yaw:f distance:f temperature:f
11039 MCU_STATUS id:B MCU_temperature:h MCU_voltage:H MCU_voltage_min:H MCU_voltage_max:H
11040 ESC_TELEMETRY_13_TO_16 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11041 ESC_TELEMETRY_17_TO_20 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11042 ESC_TELEMETRY_21_TO_24 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11043 ESC_TELEMETRY_25_TO_28 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11044 ESC_TELEMETRY_29_TO_32 temperature:4B voltage:4H current:4H totalcurrent:4H rpm:4H count:4H
11060 NAMED_VALUE_STRING time_boot_ms:I name:10s value:64s
12900 OPEN_DRONE_ID_BASIC_ID target_system:B target_component:B id_or_mac:20B id_type:B ua_type:B uas_id:20B
12901 OPEN_DRONE_ID_LOCATION target_system:B target_component:B id_or_mac:20B status:B direction:H speed_horizontal:H speed_vertical:h latitude:i longitude:i altitude_barometric:f altitude_geodetic:f height_reference:B height:f horizontal_accuracy:B vertical_accuracy:B barometer_accuracy:B speed_accuracy:B timestamp:f timestamp_accuracy:B
12902 OPEN_DRONE_ID_AUTHENTICATION target_system:B target_component:B id_or_mac:20B authentication_type:B data_page:B last_page_index:B length:B timestamp:I authentication_data:23B
12903 OPEN_DRONE_ID_SELF_ID target_system:B target_component:B id_or_mac:20B description_type:B description:23s
12904 OPEN_DRONE_ID_SYSTEM target_system:B target_component:B id_or_mac:20B operator_location_type:B classification_type:B operator_latitude:i operator_longitude:i area_count:H area_radius:H area_ceiling:f area_floor:f category_eu:B class_eu:B operator_altitude_geo:f timestamp:I
12905 OPEN_DRONE_ID_OPERATOR_ID target_system:B target_component:B id_or_mac:20B operator_id_type:B operator_id:20s
12915 OPEN_DRONE_ID_MESSAGE_PACK target_system:B target_component:B id_or_mac:20B single_message_size:B msg_pack_size:B messages:225B
12918 OPEN_DRONE_ID_ARM_STATUS status:B error:50s
12919 OPEN_DRONE_ID_SYSTEM_UPDATE target_system:B target_component:B operator_latitude:i operator_longitude:i operator_altitude_geo:f timestamp:I
12920 HYGROMETER_SENSOR id:B temperature:h humidity:H
42000 ICAROUS_HEARTBEAT status:B
42001 ICAROUS_KINEMATIC_BANDS numBands:b type1:B min1:f max1:f type2:B min2:f max2:f type3:B min3:f max3:f type4:B min4:f max4:f type5:B min5:f max5:f
50001 CUBEPILOT_RAW_RC rc_raw:32B
50002 HERELINK_VIDEO_STREAM_INFORMATION camera_id:B status:B framerate:f resolution_h:H resolution_v:H bitrate:I rotation:H uri:230s
50003 HERELINK_TELEM rssi:B snr:h rf_freq:I link_bw:I link_rate:I cpu_temp:h board_temp:h
50004 CUBEPILOT_FIRMWARE_UPDATE_START target_system:B target_component:B size:I crc:I
50005 CUBEPILOT_FIRMWARE_UPDATE_RESP target_system:B target_component:B offset:I
52000 AIRLINK_AUTH login:50s password:50s
52001 AIRLINK_AUTH_RESPONSE resp_type:B
"""
