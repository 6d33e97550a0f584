// A stand-in: see README.md.
using System;

namespace UnityEngine
{
    public static class Mathf
    {
        public static float Clamp01(float value) => Math.Max(0, Math.Min(1, value));
    }

    public struct Vector2
    {
        public float x, y;

        public Vector2(float x, float y)
        {
            this.x = x;
            this.y = y;
        }

        public static Vector2 zero => default;
    }

    public struct Vector3
    {
        public float x, y, z;

        public Vector3(float x, float y, float z)
        {
            this.x = x;
            this.y = y;
            this.z = z;
        }

        public static Vector3 zero => default;

        public static Vector3 right => new Vector3(1, 0, 0);

        public static Vector3 up => new Vector3(0, 1, 0);

        public static Vector3 forward => new Vector3(0, 0, 1);

        public static float Dot(Vector3 a, Vector3 b) => a.x * b.x + a.y * b.y + a.z * b.z;

        public static Vector3 Cross(Vector3 a, Vector3 b)
        {
            return new Vector3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
        }

        public static Vector3 Scale(Vector3 a, Vector3 b) => new Vector3(a.x * b.x, a.y * b.y, a.z * b.z);

        public float magnitude => (float)Math.Sqrt(Dot(this, this));

        public Vector3 normalized => (1 / (float)Math.Sqrt(Dot(this, this))) * this;

        public static Vector3 operator +(Vector3 a, Vector3 b) => new Vector3(a.x + b.x, a.y + b.y, a.z + b.z);

        public static Vector3 operator -(Vector3 a, Vector3 b) => new Vector3(a.x - b.x, a.y - b.y, a.z - b.z);

        public static Vector3 operator *(float d, Vector3 a) => new Vector3(d * a.x, d * a.y, d * a.z);
    }

    public struct Quaternion
    {
        public float x, y, z, w;

        public Quaternion(float x, float y, float z, float w)
        {
            this.x = x;
            this.y = y;
            this.z = z;
            this.w = w;
        }

        public static Quaternion identity => new Quaternion(0, 0, 0, 1);

        /// <summary>About z, then x, then y, as Unity does.</summary>
        public static Quaternion Euler(float x, float y, float z) => About(Vector3.up, y) * About(Vector3.right, x) * About(Vector3.forward, z);

        public static Quaternion LookRotation(Vector3 forward, Vector3 upwards)
        {
            Vector3 f = forward.normalized, r = Vector3.Cross(upwards, f).normalized, u = Vector3.Cross(f, r);
            double w = Math.Sqrt(Math.Max(0, 1 + r.x + u.y + f.z)) / 2, x = Math.Sqrt(Math.Max(0, 1 + r.x - u.y - f.z)) / 2;
            double y = Math.Sqrt(Math.Max(0, 1 - r.x + u.y - f.z)) / 2, z = Math.Sqrt(Math.Max(0, 1 - r.x - u.y + f.z)) / 2;
            double largest = Math.Max(Math.Max(w, x), Math.Max(y, z)), k = 4 * largest;
            if (largest == w)
            {
                return new Quaternion((float)((u.z - f.y) / k), (float)((f.x - r.z) / k), (float)((r.y - u.x) / k), (float)w);
            }
            if (largest == x)
            {
                return new Quaternion((float)x, (float)((r.y + u.x) / k), (float)((f.x + r.z) / k), (float)((u.z - f.y) / k));
            }
            return largest == y
                ? new Quaternion((float)((r.y + u.x) / k), (float)y, (float)((u.z + f.y) / k), (float)((f.x - r.z) / k))
                : new Quaternion((float)((f.x + r.z) / k), (float)((u.z + f.y) / k), (float)z, (float)((r.y - u.x) / k));
        }

        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(
                a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }

        public static Vector3 operator *(Quaternion a, Vector3 v)
        {
            Vector3 axis = new Vector3(a.x, a.y, a.z), across = 2 * Vector3.Cross(axis, v);
            return v + a.w * across + Vector3.Cross(axis, across);
        }

        public Quaternion normalized
        {
            get
            {
                float length = (float)Math.Sqrt(x * x + y * y + z * z + w * w);
                return new Quaternion(x / length, y / length, z / length, w / length);
            }
        }

        public static Quaternion Inverse(Quaternion a) => new Quaternion(-a.x, -a.y, -a.z, a.w);

        public static Quaternion AngleAxis(float angle, Vector3 axis) => About(axis, angle);

        public static Quaternion FromToRotation(Vector3 from, Vector3 to)
        {
            Vector3 axis = Vector3.Cross(from, to);
            return new Quaternion(axis.x, axis.y, axis.z, from.magnitude * to.magnitude + Vector3.Dot(from, to)).normalized;
        }

        static Quaternion About(Vector3 axis, float degrees)
        {
            float half = degrees * (float)Math.PI / 360, s = (float)Math.Sin(half);
            return new Quaternion(s * axis.x, s * axis.y, s * axis.z, (float)Math.Cos(half));
        }
    }

    public struct Vector4
    {
        public float x, y, z, w;

        public Vector4(float x, float y, float z, float w)
        {
            this.x = x;
            this.y = y;
            this.z = z;
            this.w = w;
        }

        public static Vector4 zero => default;

        public float this[int index]
        {
            get => index == 0 ? x : index == 1 ? y : index == 2 ? z : w;
            set
            {
                switch (index)
                {
                    case 0: x = value; break;
                    case 1: y = value; break;
                    case 2: z = value; break;
                    case 3: w = value; break;
                    default: throw new IndexOutOfRangeException();
                }
            }
        }

        public static Vector4 operator *(float d, Vector4 a) => new Vector4(d * a.x, d * a.y, d * a.z, d * a.w);
    }

    public struct Color
    {
        public float r, g, b, a;

        public Color(float r, float g, float b)
        {
            this.r = r;
            this.g = g;
            this.b = b;
            a = 1;
        }

        public static Color white => new Color(1, 1, 1);

        public Color gamma => new Color(Encoded(r), Encoded(g), Encoded(b)) { a = a };

        static float Encoded(float c) => c <= 0.0031308f ? 12.92f * c : 1.055f * (float)Math.Pow(c, 1 / 2.4) - 0.055f;
    }

    public struct Bounds
    {
        public Vector3 center, size;

        public Bounds(Vector3 center, Vector3 size)
        {
            this.center = center;
            this.size = size;
        }
    }
}
