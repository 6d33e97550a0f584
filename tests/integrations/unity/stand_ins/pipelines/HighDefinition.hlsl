// A stand-in: see ../README.md. The declarations of HDRP that PuppetlineHighDefinition.hlsl uses, with one vertex and one
// fragment shader in place of those of each pass.
#ifndef HIGH_DEFINITION_STAND_IN
#define HIGH_DEFINITION_STAND_IN

#include "Shared.hlsl"

#define SHADERPASS_FORWARD 1
#define SHADERPASS_DEPTH_ONLY 4
#define SHADERPASS_MOTION_VECTORS 7
#define SHADERPASS_SHADOWS 10
#define MATERIALFEATUREFLAGS_LIT_STANDARD 1
#define PackedVaryingsType PackedVaryingsToPS

struct AttributesMesh
{
    float3 positionOS, normalOS;
    float4 tangentOS, color;
    float2 uv0;
};

struct AttributesPass
{
    float3 previousPositionOS;
};

struct PackedVaryingsToPS
{
    float4 positionCS : SV_Position;
    float3 normalWS : TEXCOORD0;
    float4 tangentWS : TEXCOORD1;
    float4 texCoord0 : TEXCOORD2;
    float4 color : TEXCOORD3;
    float4 previousPositionCS : TEXCOORD4;
};

struct FragInputs
{
    float3x3 tangentToWorld;
    float4 texCoord0, texCoord1, texCoord2, color;
    bool isFrontFace;
};

struct PositionInputs
{
    float3 positionWS;
};

struct SurfaceData
{
    uint materialFeatures;
    float3 baseColor, geomNormalWS, normalWS, tangentWS;
    float metallic, perceptualSmoothness, ambientOcclusion, specularOcclusion;
};

struct BuiltinData
{
    float opacity;
    float3 emissiveColor;
};

void ApplyDoubleSidedFlipOrMirror(inout FragInputs input, float3 doubleSidedConstants)
{
    input.tangentToWorld[2] *= input.isFrontFace ? 1.0 : doubleSidedConstants.z;
}

float3 Orthonormalize(float3 tangent, float3 normal) { return normalize(tangent - dot(tangent, normal) * normal); }

float GetInverseCurrentExposureMultiplier() { return 1; }

void InitBuiltinData(
    PositionInputs posInput, float alpha, float3 normalWS, float3 backNormalWS, float4 texCoord1, float4 texCoord2,
    out BuiltinData builtinData)
{
    builtinData.opacity = alpha;
    builtinData.emissiveColor = float3(0, 0, 0);
}

void PostInitBuiltinData(float3 V, PositionInputs posInput, SurfaceData surfaceData, inout BuiltinData builtinData) {}

#endif
