// A stand-in: see ../README.md.
using System;

namespace NUnit.Framework
{
    [AttributeUsage(AttributeTargets.Method)]
    public sealed class TestAttribute : Attribute
    {
    }

    public class Constraint
    {
        readonly Func<object, bool> holds;

        public Constraint(Func<object, bool> holds)
        {
            this.holds = holds;
        }

        public Constraint Not => new Constraint(value => !holds(value));

        public bool Holds(object value) => holds(value);
    }

    public sealed class EqualConstraint : Constraint
    {
        readonly object expected;

        public EqualConstraint(object expected)
            : base(value => value.Equals(expected))
        {
            this.expected = expected;
        }

        public Constraint Within(object amount)
        {
            return new Constraint(value => Math.Abs(Convert.ToDouble(value) - Convert.ToDouble(expected)) <= Convert.ToDouble(amount));
        }
    }

    public static class Is
    {
        public static Constraint True => new Constraint(value => (bool)value);

        public static Constraint False => True.Not;

        public static EqualConstraint EqualTo(object expected) => new EqualConstraint(expected);

        public static class Not
        {
            public static Constraint Null => new Constraint(value => !ReferenceEquals(value, null));
        }
    }

    public static class Assert
    {
        public static void That<T>(T actual, Constraint expression)
        {
            if (!expression.Holds(actual))
            {
                throw new Exception("found " + actual);
            }
        }
    }
}
