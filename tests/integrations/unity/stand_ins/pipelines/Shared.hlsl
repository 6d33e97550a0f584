// A stand-in: see ../README.md. What URP and HDRP have in common.
#ifndef COMMON_STAND_IN
#define COMMON_STAND_IN

#define half float
#define half2 float2
#define half3 float3
#define half4 float4
#define CBUFFER_START(name) cbuffer name {
#define CBUFFER_END }
#define UNITY_VERTEX_INPUT_INSTANCE_ID
#define UNITY_VERTEX_OUTPUT_STEREO
#define UNITY_SETUP_INSTANCE_ID(input)
#define UNITY_TRANSFER_INSTANCE_ID(input, output)
#define UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output)
#define UNITY_SETUP_STEREO_EYE_INDEX_POST_VERTEX(input)
#define UNITY_REVERSED_Z 1
#define UNITY_NEAR_CLIP_VALUE 1.0
#define UNITY_UV_STARTS_AT_TOP 1
#define ZERO_INITIALIZE(type, name) name = (type)0;

float4x4 _ObjectToWorld;
float4x4 _ViewProjection;
float4x4 _PreviousObjectToWorld;
float4 unity_MotionVectorsParams;

float3 TransformObjectToWorld(float3 positionOS) { return mul(_ObjectToWorld, float4(positionOS, 1)).xyz; }

float3 TransformObjectToWorldNormal(float3 normalOS) { return normalize(mul((float3x3)_ObjectToWorld, normalOS)); }

float4 TransformWorldToHClip(float3 positionWS) { return mul(_ViewProjection, float4(positionWS, 1)); }

#endif
