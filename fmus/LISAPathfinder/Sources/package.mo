within LISAPathfinder;
package Sources "Sources of the external signals"
  extends Icons.Package;
  annotation (Documentation(info = "<html>
<p>Noise, injections and stray forces enter the loops through these blocks.</p>
</html>"));
end Sources;
