// The passes of the High Definition Render Pipeline, around its own passes for forward-only materials. A pass defines
// SHADERPASS before it includes this file.

#ifndef PUPPETLINE_HIGH_DEFINITION_INCLUDED
#define PUPPETLINE_HIGH_DEFINITION_INCLUDED

// Filters of shadows. Versions of HDRP have different names for them.
#define SHADOW_MEDIUM
#define PUNCTUAL_SHADOW_MEDIUM
#define DIRECTIONAL_SHADOW_MEDIUM
#define AREA_SHADOW_MEDIUM

#define USE_CLUSTERED_LIGHTLIST
#define ATTRIBUTES_NEED_NORMAL
#define ATTRIBUTES_NEED_TANGENT
#define ATTRIBUTES_NEED_TEXCOORD0
#define ATTRIBUTES_NEED_COLOR
#define VARYINGS_NEED_POSITION_WS
#define VARYINGS_NEED_TANGENT_TO_WORLD
#define VARYINGS_NEED_TEXCOORD0
#define VARYINGS_NEED_COLOR
#define VARYINGS_NEED_CULLFACE

#include "Packages/com.unity.render-pipelines.core/ShaderLibrary/Common.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/ShaderLibrary/ShaderVariables.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/FragInputs.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/ShaderPass.cs.hlsl"
#if SHADERPASS != SHADERPASS_SHADOWS
#define WRITE_NORMAL_BUFFER
#endif
#include "PuppetlineSurface.hlsl"
#include "Puppetline.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Material/Material.hlsl"
#if SHADERPASS == SHADERPASS_FORWARD
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Lighting/Lighting.hlsl"
#define HAS_LIGHTLOOP
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Lighting/LightLoop/LightLoopDef.hlsl"
#endif
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Material/Lit/Lit.hlsl"
#if SHADERPASS == SHADERPASS_FORWARD
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Lighting/LightLoop/LightLoop.hlsl"
#endif
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/VaryingMesh.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Material/BuiltinUtilities.hlsl"
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/Material/MaterialUtilities.hlsl"

// HDRP's passes call this for the surface of a pixel.
void GetSurfaceAndBuiltinData(
    FragInputs input, float3 V, inout PositionInputs posInput, out SurfaceData surfaceData, out BuiltinData builtinData)
{
    ApplyDoubleSidedFlipOrMirror(input, float3(-1, -1, -1));
    float4 base = PuppetlineBase(input.texCoord0.xy, input.color);
    ZERO_INITIALIZE(SurfaceData, surfaceData);
    surfaceData.materialFeatures = MATERIALFEATUREFLAGS_LIT_STANDARD;
    surfaceData.baseColor = base.rgb;
    surfaceData.metallic = _Metallic;
    surfaceData.perceptualSmoothness = _Smoothness;
    surfaceData.ambientOcclusion = 1;
    surfaceData.specularOcclusion = 1;
    surfaceData.geomNormalWS = input.tangentToWorld[2];
    surfaceData.normalWS = normalize(input.tangentToWorld[2]);
    surfaceData.tangentWS = Orthonormalize(input.tangentToWorld[0], surfaceData.normalWS);
    InitBuiltinData(posInput, base.a, surfaceData.normalWS, -surfaceData.normalWS, input.texCoord1, input.texCoord2, builtinData);
    // The result is as bright on the screen as in the other pipelines, whatever the camera's exposure.
    builtinData.emissiveColor = PuppetlineEmission(input.texCoord0.xy) * GetInverseCurrentExposureMultiplier();
    PostInitBuiltinData(V, posInput, surfaceData, builtinData);
}

#if SHADERPASS == SHADERPASS_MOTION_VECTORS
// HDRP reads the previous position from the vertex input only for meshes that Unity has deformed. This makes it do so here.
float4 PuppetlineMotionParameters()
{
    return float4(1, unity_MotionVectorsParams.yzw);
}
#define unity_MotionVectorsParams PuppetlineMotionParameters()
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/ShaderPassMotionVectors.hlsl"
#undef unity_MotionVectorsParams
#elif SHADERPASS == SHADERPASS_FORWARD
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/ShaderPassForward.hlsl"
#else
#include "Packages/com.unity.render-pipelines.high-definition/Runtime/RenderPipeline/ShaderPass/ShaderPassDepthOnly.hlsl"
#endif

struct PuppetlineInputs
{
    PUPPETLINE_INPUTS
    UNITY_VERTEX_INPUT_INSTANCE_ID
};

// Blend the transforms, and continue with HDRP's own vertex shader.
PackedVaryingsType PuppetlineVertex(PuppetlineInputs input)
{
    PuppetlineRest rest;
    PUPPETLINE_REST(rest, input)
    PuppetlinePoint shown = PuppetlineShown(rest);
    AttributesMesh mesh;
    ZERO_INITIALIZE(AttributesMesh, mesh);
    UNITY_TRANSFER_INSTANCE_ID(input, mesh);
    mesh.positionOS = shown.position;
    mesh.normalOS = shown.normal;
    // There are no tangents and no normal maps, so any direction in the surface is suitable.
    mesh.tangentOS = float4(PuppetlineTangent(shown.normal), 1);
    mesh.uv0 = PuppetlineTexturePlace(input.uv);
    mesh.color = input.color;
#if SHADERPASS == SHADERPASS_MOTION_VECTORS
    AttributesPass before;
    ZERO_INITIALIZE(AttributesPass, before);
    before.previousPositionOS = PuppetlinePositionBefore(rest);
    return Vert(mesh, before);
#else
    return Vert(mesh);
#endif
}

#endif
