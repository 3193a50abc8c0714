within LISAPathfinder;
package Constants "Mathematical constants; the library needs no other one, so that it can be opened by itself"
  extends Icons.Package;
  final constant Real pi(final unit = "1") = 3.14159265358979323846
    "Ratio of a circle's circumference to its diameter";
end Constants;
