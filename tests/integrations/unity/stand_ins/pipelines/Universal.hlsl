// A stand-in: see ../README.md. The declarations of URP that PuppetlineUniversal.hlsl uses.
#ifndef UNIVERSAL_STAND_IN
#define UNIVERSAL_STAND_IN

#include "Shared.hlsl"

#define UNITY_PREV_MATRIX_M _PreviousObjectToWorld

float4x4 _NonJitteredViewProjMatrix;
float4x4 _PrevViewProjMatrix;

struct SurfaceData
{
    half3 albedo, specular, normalTS, emission;
    half metallic, smoothness, occlusion, alpha, clearCoatMask, clearCoatSmoothness;
};

struct InputData
{
    float3 positionWS;
    half3 normalWS, viewDirectionWS, vertexLighting, bakedGI;
    float4 shadowCoord;
    half fogCoord;
    float2 normalizedScreenSpaceUV;
    half4 shadowMask;
};

half4 UniversalFragmentPBR(InputData inputData, SurfaceData surfaceData)
{
    float light = inputData.normalWS.z + inputData.shadowCoord.x + inputData.shadowMask.x + inputData.normalizedScreenSpaceUV.x;
    return half4(light * surfaceData.albedo + surfaceData.emission + inputData.bakedGI + inputData.vertexLighting, surfaceData.alpha);
}

half3 VertexLighting(float3 positionWS, half3 normalWS) { return positionWS + normalWS; }

half3 NormalizeNormalPerPixel(half3 normalWS) { return normalize(normalWS); }

half3 GetWorldSpaceNormalizeViewDir(float3 positionWS) { return normalize(-positionWS); }

float4 TransformWorldToShadowCoord(float3 positionWS) { return float4(positionWS, 0); }

half3 SampleSH(half3 normalWS) { return normalWS; }

half3 MixFog(half3 color, half fog) { return color * fog; }

float ComputeFogFactor(float z) { return z; }

float2 GetNormalizedScreenSpaceUV(float4 positionCS) { return positionCS.xy; }

float3 ApplyShadowBias(float3 positionWS, float3 normalWS, float3 lightDirection) { return positionWS + normalWS + lightDirection; }

#endif
